//! A duration times a number, to the nanosecond that ROS 2 gets.

/// [-] A number that durations are multiplied by.
///
/// `rclcpp` computes the product in `long double`, which on x86-64 has 64 bits of mantissa, and
/// cuts off the fraction. Rust has no such type; integers give the same result.
#[derive(Debug, Clone, Copy)]
pub(super) struct Factor {
    mantissa: u64,
    /// The factor is `mantissa / 2^scale`.
    scale: u32,
}

/// [-] Bits of an `f64` behind the leading one.
const FRACTION_BITS: u32 = 52;

/// [-] The exponent that an `f64` stores for 1.
const EXPONENT_BIAS: u64 = 1023;

/// [-] Bits of an x87 mantissa.
const MANTISSA_BITS: u32 = 64;

impl Factor {
    /// From a number of at least 1 and less than 2^52.
    pub(super) fn new(number: f64) -> Self {
        assert!((1.0..4_503_599_627_370_496.0).contains(&number), "out of range: {number}");
        let bits = number.to_bits();
        let fraction = bits & ((1 << FRACTION_BITS) - 1);
        #[expect(clippy::cast_possible_truncation, reason = "from 0 to 51, by the assertion")]
        let exponent = ((bits >> FRACTION_BITS) - EXPONENT_BIAS) as u32;
        Self { mantissa: fraction | 1 << FRACTION_BITS, scale: FRACTION_BITS - exponent }
    }

    /// [ns] The product, as far as it fits.
    pub(super) fn times(self, nanoseconds: i64) -> i64 {
        let exact = u128::from(nanoseconds.unsigned_abs()) * u128::from(self.mantissa);
        let product = i64::try_from(rounded(exact) >> self.scale).unwrap_or(i64::MAX);
        if nanoseconds < 0 { -product } else { product }
    }
}

/// To the nearest number of 64 significant bits, half to even.
fn rounded(exact: u128) -> u128 {
    let excess = (u128::BITS - exact.leading_zeros()).saturating_sub(MANTISSA_BITS);
    if excess == 0 {
        return exact;
    }
    let half = 1 << (excess - 1);
    let rest = exact & ((1 << excess) - 1);
    let kept = exact >> excess;
    let up = half < rest || (half == rest && kept % 2 == 1);
    (kept + u128::from(up)) << excess
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Penalty, duration and product, by gcc's `long double` on x86-64. In the last six, exact
    /// arithmetic gives another result; in the seven before them, `f64` does.
    const BY_GCC: [(f64, i64, i64); 18] = [
        (7.75908, 747_516_259_862, 6_547_554_721_432),
        (1.560_039_898_809_720_6, -5_579_761, -14_284_410),
        (0.29, -1_368, -1_764),
        (1.0, -5_714_509, -11_429_018),
        (0.1, -69_902_777, -76_893_054),
        (0.1, -275_930_213_350_000_000, -303_523_234_685_000_024),
        (0.85, -213_860_974_427_931_296, -395_642_802_691_672_916),
        (2.89182, -373_024_654_687_000_000, -1_451_744_811_603_960_361),
        (3.42603, 24_633_482_683_021_629, 109_028_533_359_534_218),
        (0.74, -513_937_558_063_630_149, -894_251_351_030_716_454),
        (0.89, 98_898_754_474_984_224, 186_918_645_957_720_195),
        (6.16661, 532_828_231_787_028, 3_818_572_134_207_232),
        (1.727_355_966_326_898_5, 3_075_268_598_418_913_742, 8_387_352_159_955_583_854),
        (1.78997, 2_737_251_825_829_000_000, 7_636_850_476_508_135_905),
        (0.2267, -4_623_600_559_528_907_112, -5_671_770_806_374_110_926),
        (0.06, -6_830_433_261_283_849_098, -7_240_259_256_960_880_408),
        (0.1, -647_068_093_672_930_495, -711_774_903_040_223_602),
        (7.99464, 547_367_693_247_716_787, 4_923_375_348_393_643_547),
    ];

    #[test]
    fn products_are_those_of_long_double() {
        for (penalty, nanoseconds, product) in BY_GCC {
            assert_eq!(Factor::new(1.0 + penalty).times(nanoseconds), product, "{penalty}");
        }
    }

    #[test]
    fn a_product_that_does_not_fit_is_the_greatest_that_does() {
        assert_eq!(Factor::new(2.0).times(i64::MAX), i64::MAX);
        assert_eq!(Factor::new(2.0).times(i64::MIN + 1), -i64::MAX);
    }
}
