//! How a measured range differs from the true one.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

/// [-] The LiDAR's own stream of the seed: no other sensor's draws can shift it.
const LIDAR_STREAM: u64 = 1;

/// How far a LiDAR's measurements are from the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Noise {
    /// Every range is true.
    Ideal,
    /// Gaussian of 10 mm, as in Gazebo's model of the TurtleBot3.
    Gazebo,
    /// The LDS-01's data sheet, reading ± as three sigma: a bias that stays for the run, Gaussian
    /// noise that grows with the range, whole millimetres, and now and then no measurement.
    Lds01,
}

/// A LiDAR's noise over a run.
pub(crate) struct RangeNoise {
    noise: Noise,
    /// [-] In -1 to 1, for the whole run.
    bias: f64,
    random: ChaCha8Rng,
}

impl RangeNoise {
    pub(crate) fn new(noise: Noise, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(LIDAR_STREAM);
        let bias = 2.0 * uniform(&mut random) - 1.0;
        Self { noise, bias, random }
    }

    /// Errs like this from now on; its bias stays.
    pub(crate) const fn set(&mut self, noise: Noise) {
        self.noise = noise;
    }

    /// Whether every measurement is the range itself.
    pub(crate) fn is_ideal(&self) -> bool {
        self.noise == Noise::Ideal
    }

    /// [m] What is measured where the wall is `range` away: NaN where the measurement fails.
    ///
    /// Infinity, no wall, draws as much as a wall does, so that a scan's noise does not depend on
    /// what the beams before it met.
    pub(crate) fn measure(&mut self, range: f64) -> f64 {
        match self.noise {
            Noise::Ideal => range,
            Noise::Gazebo => range + 0.010 * normal(&mut self.random),
            Noise::Lds01 => {
                let error = lds01_sigma(range) * normal(&mut self.random);
                let is_lost = uniform(&mut self.random) < LDS01_LOST;
                if range.is_infinite() {
                    return range;
                }
                let measured = range + self.bias * lds01_bias_max(range) + error;
                if is_lost { f64::NAN } else { (measured * 1e3).round() * 1e-3 }
            }
        }
    }
}

/// [-] Share of an LDS-01's measurements that fail: the upper end of 0.5 to 1 %.
const LDS01_LOST: f64 = 0.01;

/// [m] Half the accuracy, which is 15 mm below 0.5 m and 5 % from there.
fn lds01_bias_max(range: f64) -> f64 {
    if range < 0.5 { 0.0075 } else { 0.025 * range }
}

/// [m] A third of the precision, which is 10 mm or 3.5 %.
fn lds01_sigma(range: f64) -> f64 {
    (0.035 * range).max(0.010) / 3.0
}

/// [-] In 0 to 1, without the 1.
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 * f64::EPSILON / 2.0
}

/// [-] Of mean 0 and standard deviation 1, by Box and Muller.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    // The ziggurat of `rand_distr` is faster, but how much it draws varies, and its `exp` becomes the
    // platform's as soon as any crate of the build turns on `num-traits/std`.
    let radius = (-2.0 * libm::log(1.0 - uniform(random))).sqrt();
    radius * libm::cos(TAU * uniform(random))
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "what must be exact is compared exactly")]
mod tests {
    use super::*;

    const SEED: u64 = 7;
    const DRAWS: usize = 100_000;

    /// What a LiDAR of this seed measures at `range`, run after run of it.
    fn measure(noise: Noise, seed: u64, range: f64) -> Vec<f64> {
        let mut noise = RangeNoise::new(noise, seed);
        (0..DRAWS).map(|_| noise.measure(range)).collect()
    }

    fn mean_and_sigma(values: &[f64]) -> (f64, f64) {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        (mean, variance.sqrt())
    }

    #[test]
    fn without_noise_every_range_is_true() {
        assert!(measure(Noise::Ideal, SEED, 1.234).iter().all(|&range| range == 1.234));
    }

    #[test]
    fn gazebo_is_gaussian_of_ten_millimetres_about_the_truth() {
        for range in [0.2, 7.0] {
            let values = measure(Noise::Gazebo, SEED, range);
            let (mean, sigma) = mean_and_sigma(&values);
            assert!((mean - range).abs() < 1e-4, "SEED={SEED} {range}: mean {mean}");
            assert!((sigma - 0.010).abs() < 1e-4, "SEED={SEED} {range}: sigma {sigma}");

            // A Gaussian has 31.7 % beyond one sigma, 4.55 % beyond two, 0.27 % beyond three.
            for (sigmas, share) in [(1.0, 0.317_311), (2.0, 0.045_500), (3.0, 0.002_700)] {
                let beyond = values.iter().filter(|&value| (value - range).abs() > 0.010 * sigmas);
                let found = beyond.count() as f64 / DRAWS as f64;
                let scatter = (share * (1.0 - share) / DRAWS as f64).sqrt();
                assert!((found - share).abs() < 4.0 * scatter, "SEED={SEED} {sigmas}: {found}");
            }
        }
    }

    #[test]
    fn lds01_is_as_its_data_sheet_says() {
        // Range, sigma, greatest bias.
        for (range, sigma, bias_max) in [(0.2, 0.010 / 3.0, 0.0075), (3.0, 0.035, 0.075)] {
            let all = measure(Noise::Lds01, SEED, range);
            let values: Vec<f64> = all.iter().copied().filter(|value| !value.is_nan()).collect();
            let lost = (DRAWS - values.len()) as f64 / DRAWS as f64;
            assert!((lost - 0.01).abs() < 0.001, "SEED={SEED} {range}: lost {lost}");

            let (mean, found) = mean_and_sigma(&values);
            assert!((found - sigma).abs() < 0.02 * sigma, "SEED={SEED} {range}: sigma {found}");
            assert!((mean - range).abs() <= bias_max + 1e-4, "SEED={SEED} {range}: mean {mean}");

            let is_whole = |value: &f64| (value * 1e3 - (value * 1e3).round()).abs() < 1e-9;
            assert!(values.iter().all(is_whole), "SEED={SEED} {range}");
        }
    }

    #[test]
    fn the_lds01_has_one_bias_per_run_anywhere_within_half_its_accuracy() {
        let bias = |seed| RangeNoise::new(Noise::Lds01, seed).bias;
        let biases: Vec<f64> = (0..10_000).map(bias).collect();
        let (mean, sigma) = mean_and_sigma(&biases);
        assert!(mean.abs() < 0.02, "mean {mean}");
        assert!((sigma - 1.0 / 3_f64.sqrt()).abs() < 0.01, "sigma {sigma}");
        assert!(biases.iter().all(|bias| bias.abs() <= 1.0));
    }

    #[test]
    fn no_wall_stays_no_wall() {
        for noise in [Noise::Ideal, Noise::Gazebo, Noise::Lds01] {
            let values = measure(noise, SEED, f64::INFINITY);
            assert!(values.iter().all(|&value| value == f64::INFINITY), "{noise:?}");
        }
    }

    #[test]
    fn what_one_beam_meets_does_not_change_the_noise_of_the_next() {
        for noise in [Noise::Gazebo, Noise::Lds01] {
            let [mut near, mut none] = [0, 1].map(|_| RangeNoise::new(noise, SEED));
            for _ in 0..1000 {
                near.measure(0.2);
                none.measure(f64::INFINITY);
                let (a, b) = (near.measure(1.0), none.measure(1.0));
                assert_eq!(a.to_bits(), b.to_bits(), "SEED={SEED} {noise:?}");
            }
        }
    }
}
