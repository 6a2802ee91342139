//! Each fault does what it says, no other, and the same every time.

use std::time::Duration;

use interfaces::{Header, LaserScan, Odometry, Stamp, VelocityCommand};

use super::{FaultCounts, Faults, FaultyLink, QUEUE_MAX};
use crate::config::{Layers, Setting};

const SEED: u64 = 7;

/// [-] Enough for shares to be told to a hundredth.
const SAMPLES: u64 = 20_000;

/// A controller's.
const PERIOD: Duration = Duration::from_millis(50);

/// When sample number `sequence` sets out; the clock has run for an hour before the first.
fn moment(sequence: u64) -> Stamp {
    let since_first = Duration::from_nanos(50_000_000 * sequence);
    Stamp::ZERO.after(Duration::from_secs(3_600)).after(since_first)
}

fn command(sequence: u64) -> VelocityCommand {
    VelocityCommand {
        header: Header { stamp: moment(sequence), sequence, ..Header::default() },
        linear: 0.2,
        angular: sequence as f64,
    }
}

/// What arrives of so many commands, when, and what the link says about it. Looked at every
/// millisecond, and until long after the last.
fn send_so_many(
    faults: &Faults,
    seed: u64,
    samples: u64,
) -> (Vec<(Stamp, VelocityCommand)>, FaultCounts) {
    let mut link = FaultyLink::new(faults, seed, 3);
    let mut arrived = Vec::new();
    for sequence in 0..samples + 40 {
        if sequence < samples {
            link.push(moment(sequence), command(sequence));
        }
        for millisecond in 0..50 {
            let now = moment(sequence).after(Duration::from_millis(millisecond));
            while let Some(sample) = link.pop(now) {
                arrived.push((now, sample));
            }
        }
    }
    (arrived, *link.counts())
}

fn send(faults: &Faults) -> (Vec<(Stamp, VelocityCommand)>, FaultCounts) {
    send_so_many(faults, SEED, SAMPLES)
}

fn sequences(arrived: &[(Stamp, VelocityCommand)]) -> Vec<u64> {
    arrived.iter().map(|(_, command)| command.header.sequence).collect()
}

fn bytes(arrived: &[(Stamp, VelocityCommand)]) -> Vec<u8> {
    let bytes = |(now, command): &(Stamp, VelocityCommand)| {
        [bytemuck::bytes_of(now), bytemuck::bytes_of(command)].concat()
    };
    arrived.iter().flat_map(bytes).collect()
}

#[track_caller]
fn assert_share(count: u64, share: f64) {
    let found = count as f64 / SAMPLES as f64;
    assert!((found - share).abs() < 0.01, "SEED={SEED}: {found} instead of {share}");
}

/// A bit of everything.
const HARSH: Faults = Faults {
    loss: 0.1,
    delay_max_s: 0.12,
    duplicate: 0.1,
    reorder: 0.1,
    corrupt: 0.1,
    stamp_jump: 0.1,
    stamp_jump_max_s: 3_600.0,
    stall: 0.01,
    stall_s: 0.5,
    from_s: 0.0,
    until_s: None,
};

#[test]
fn without_faults_everything_arrives_at_once_as_it_was() {
    let (arrived, counts) = send(&Faults::default());

    let whole: Vec<_> = (0..SAMPLES).map(|number| (moment(number), command(number))).collect();
    assert_eq!(bytes(&arrived), bytes(&whole));
    assert_eq!(counts, FaultCounts { pushed: SAMPLES, ..FaultCounts::default() });
}

#[test]
fn the_same_seed_does_the_same_bit_for_bit_and_another_seed_or_stream_does_not() {
    let run = |seed| {
        let (arrived, counts) = send_so_many(&HARSH, seed, 1_000);
        (bytes(&arrived), counts)
    };
    assert_eq!(run(SEED), run(SEED));
    assert_ne!(run(SEED), run(SEED + 1));

    let lost_of = |stream| {
        let mut link = FaultyLink::new(&Faults { loss: 0.5, ..Faults::default() }, SEED, stream);
        let arrives = |number| {
            link.push(moment(number), command(number));
            link.pop(moment(number)).is_some()
        };
        (0..100).map(arrives).collect::<Vec<_>>()
    };
    assert_ne!(lost_of(1), lost_of(2));
}

#[test]
fn lost_samples_are_as_many_as_was_asked_for_and_the_others_are_whole() {
    let (arrived, counts) = send(&Faults { loss: 0.3, ..Faults::default() });

    assert_share(counts.lost, 0.3);
    assert_eq!(arrived.len() as u64, SAMPLES - counts.lost);
    assert!(
        arrived.iter().all(|(now, sample)| *sample == command(sample.header.sequence)
            && *now == sample.header.stamp)
    );
    let (none, _) = send(&Faults { loss: 1.0, ..Faults::default() });
    assert!(none.is_empty(), "SEED={SEED}");
}

#[test]
fn a_late_sample_is_no_later_than_the_longest_delay_and_overtaken_by_those_that_are_not() {
    let (arrived, counts) = send(&Faults { delay_max_s: 0.12, ..Faults::default() });

    let late = |(now, sample): &(Stamp, VelocityCommand)| now.since(sample.header.stamp);
    let latest = arrived.iter().map(late).max().unwrap();
    assert!(Duration::from_millis(115) < latest && latest <= Duration::from_millis(120));
    let mean = arrived.iter().map(|one| late(one).as_secs_f64()).sum::<f64>() / SAMPLES as f64;
    assert!((mean - 0.0605).abs() < 0.001, "SEED={SEED}: {mean} s on average");
    assert_eq!(counts.delayed, SAMPLES);
    assert!(!sequences(&arrived).is_sorted(), "SEED={SEED}: nobody was overtaken");
    let mut all = sequences(&arrived);
    all.sort_unstable();
    assert!(all.into_iter().eq(0..SAMPLES), "SEED={SEED}");
}

#[test]
fn a_duplicate_is_the_same_sample_with_the_same_number() {
    let (arrived, counts) = send(&Faults { duplicate: 0.2, ..Faults::default() });

    assert_share(counts.duplicated, 0.2);
    assert_eq!(arrived.len() as u64, SAMPLES + counts.duplicated);
    assert!(arrived.iter().all(|(_, sample)| *sample == command(sample.header.sequence)));
    let (twice, _) = send(&Faults { duplicate: 1.0, ..Faults::default() });
    assert!(sequences(&twice).into_iter().eq((0..SAMPLES).flat_map(|number| [number; 2])));
}

#[test]
fn a_sample_that_is_held_back_comes_right_after_its_successor() {
    let (arrived, counts) = send(&Faults { reorder: 1.0, ..Faults::default() });

    let swapped = (0..SAMPLES).step_by(2).flat_map(|number| [number + 1, number]);
    assert!(sequences(&arrived).into_iter().eq(swapped));
    assert_eq!(counts.reordered, SAMPLES / 2);
    let (_, counts) = send(&Faults { reorder: 0.1, ..Faults::default() });
    // One is not held back while another is.
    assert_share(counts.reordered, 0.1 / 1.1);
}

#[test]
fn a_corrupted_sample_keeps_its_header_and_nothing_else_is_sacred() {
    let (arrived, counts) = send(&Faults { corrupt: 0.5, ..Faults::default() });

    assert_share(counts.corrupted, 0.5);
    assert!((0..SAMPLES).eq(sequences(&arrived)));
    assert!(arrived.iter().all(|(now, sample)| sample.header.stamp == *now));
    let changed = arrived.iter().filter(|(_, sample)| *sample != command(sample.header.sequence));
    assert_eq!(changed.clone().count() as u64, counts.corrupted);
    let any = |wanted: fn(f64) -> bool| {
        let mut values = changed.clone().flat_map(|(_, sample)| [sample.linear, sample.angular]);
        values.any(wanted)
    };
    assert!(any(f64::is_nan) && any(f64::is_infinite) && any(f64::is_subnormal));
    assert!(any(|value| 1e299 < value && value.is_finite()));
    // A flipped bit of a small number.
    assert!(any(|value| 0.1 < value && value < 0.2), "SEED={SEED}");
}

#[test]
fn a_corrupted_scan_has_from_one_bad_beam_to_no_good_one() {
    let mut link = FaultyLink::new(&Faults { corrupt: 1.0, ..Faults::default() }, SEED, 0);
    let is_good = |range: &&f32| range.to_bits() == 1_f32.to_bits();
    let good = |scan: &LaserScan| scan.range.iter().filter(is_good).count();
    let counts: Vec<_> = (0..1_000)
        .map(|number| {
            let mut scan = LaserScan { length: 1440, ..LaserScan::default() };
            scan.range.fill(1.0);
            link.push(moment(number), scan);
            good(&link.pop(moment(number)).unwrap())
        })
        .collect();

    assert!(counts.contains(&0) && counts.contains(&1439) && counts.contains(&1440), "SEED={SEED}");
}

#[test]
fn a_stamp_moves_either_way_by_no_more_than_was_said_and_never_beyond_the_clock() {
    let hour = Duration::from_secs(3_600);
    let (arrived, counts) = send(&Faults { stamp_jump: 1.0, ..Faults::default() });

    assert_eq!(counts.stamps_moved, SAMPLES);
    let ahead = arrived.iter().filter(|(now, sample)| *now < sample.header.stamp).count() as u64;
    assert_share(ahead, 0.5);
    let jump = |(now, sample): &(Stamp, VelocityCommand)| {
        now.since(sample.header.stamp).max(sample.header.stamp.since(*now))
    };
    let farthest = arrived.iter().map(jump).max().unwrap();
    assert!(hour.mul_f64(0.99) < farthest && farthest <= hour, "SEED={SEED}: {farthest:?}");

    let faults = Faults { stamp_jump: 1.0, stamp_jump_max_s: 1e9, ..Faults::default() };
    let mut link = FaultyLink::new(&faults, SEED, 0);
    let stamps: Vec<_> = (0..100)
        .map(|number| {
            link.push(moment(number), command(number));
            link.pop(moment(number)).unwrap().header.stamp
        })
        .collect();
    assert!(stamps.contains(&Stamp::ZERO), "SEED={SEED}");
}

#[test]
fn what_is_sent_in_a_stall_is_lost_and_afterwards_samples_pass_again() {
    let (arrived, counts) = send(&Faults { stall: 0.01, stall_s: 1.0, ..Faults::default() });

    assert_eq!(arrived.len() as u64 + counts.stalled, SAMPLES);
    // The one that begins a stall and the nineteen after it.
    assert!(counts.stalled.abs_diff(20 * counts.stalls) < 20, "SEED={SEED}: {counts:?}");
    let gaps = arrived.windows(2).map(|pair| pair[1].0.since(pair[0].0));
    let gaps: Vec<_> = gaps.filter(|gap| PERIOD < *gap).collect();
    assert!(10 < gaps.len() && gaps.iter().all(|gap| Duration::from_secs(1) <= *gap));
}

#[test]
fn what_is_under_way_when_a_stall_begins_arrives_after_it() {
    let faults = Faults { stall: 0.5, stall_s: 2.0, delay_max_s: 1.0, ..Faults::default() };
    let stalls_with_one_under_way = |seed| {
        let mut link = FaultyLink::new(&faults, seed, 0);
        link.push(moment(0), command(0));
        let is_under_way = link.due().is_some();
        link.push(moment(1), command(1));
        (is_under_way && link.counts().stalls == 1).then_some(link)
    };
    let mut link = (0..).find_map(stalls_with_one_under_way).unwrap();
    let over = moment(1).after(Duration::from_secs(2));

    assert_eq!(link.due(), Some(over));
    assert!(link.pop(over.before(Duration::from_nanos(1))).is_none());
    assert_eq!(link.pop(over), Some(command(0)));
}

#[test]
fn faults_begin_and_cease_when_they_should() {
    let faults = Faults { from_s: 100.0, until_s: Some(200.0), ..HARSH };
    let (arrived, counts) = send(&faults);

    let is_whole = |(now, sample): &&(Stamp, VelocityCommand)| {
        *sample == command(sample.header.sequence) && *now == sample.header.stamp
    };
    assert!(0 < counts.missing() && counts.missing() < 2_000);
    let whole: Vec<_> = arrived.iter().filter(is_whole).map(|one| one.1.header.sequence).collect();
    // 2000 samples before, and all from the 4000th on.
    assert!(whole.iter().filter(|number| **number < 2_000).copied().eq(0..2_000), "SEED={SEED}");
    assert!(
        whole.iter().filter(|number| 4_000 <= **number).copied().eq(4_000..SAMPLES),
        "SEED={SEED}"
    );
}

#[test]
fn one_kind_of_fault_does_not_change_whom_another_befalls() {
    let alone = Faults { loss: 0.2, ..Faults::default() };
    let among_others = Faults { loss: 0.2, corrupt: 0.5, duplicate: 0.5, stamp_jump: 0.5, ..alone };
    let mut arrived = [alone, among_others].map(|faults| sequences(&send(&faults).0));
    arrived[1].dedup();

    assert_eq!(arrived[0], arrived[1], "SEED={SEED}");
}

#[test]
fn every_sample_is_accounted_for_whatever_happens() {
    for seed in 0..100 {
        let (arrived, counts) = send_so_many(&HARSH, seed, 500);
        // One may be held back still.
        let sent = counts.pushed + counts.duplicated - counts.missing();
        assert!(
            sent - arrived.len() as u64 <= 1,
            "SEED={seed}: {counts:?}, {} arrived",
            arrived.len()
        );
    }
}

#[test]
fn a_delay_that_is_longer_than_the_queue_loses_the_oldest() {
    let mut link = FaultyLink::new(&Faults { delay_max_s: 1e6, ..Faults::default() }, SEED, 0);
    let samples = QUEUE_MAX as u64 + 5;
    for number in 0..samples {
        link.push(moment(0), command(number));
    }
    let mut arrived: Vec<_> = std::iter::from_fn(|| link.pop(Stamp::from_nanoseconds(u64::MAX)))
        .map(|sample| sample.header.sequence)
        .collect();
    arrived.sort_unstable();

    assert!(arrived.into_iter().eq(5..samples));
    assert_eq!(link.counts().overflowed, 5);
}

#[test]
fn what_is_under_way_at_a_pause_is_lost_and_counted() {
    let mut link = FaultyLink::new(&Faults { delay_max_s: 1e6, ..Faults::default() }, SEED, 0);
    for number in 0..3 {
        link.push(moment(number), command(number));
    }
    link.abandon();

    assert_eq!(link.due(), None);
    assert_eq!(link.counts().missing(), 3);
}

#[test]
fn nothing_is_allocated_after_construction() {
    let mut link = FaultyLink::<Odometry>::new(&HARSH, SEED, 0);
    let allocations = allocation_counter::measure(|| {
        for number in 0..10_000 {
            link.push(moment(number), Odometry::default());
            while let Some(sample) = link.pop(moment(number)) {
                std::hint::black_box(sample);
            }
        }
    });
    assert_eq!(allocations.count_total, 0);
}

#[test]
fn values_that_mean_nothing_are_refused_all_at_once_each_at_its_place() {
    let sets = ["loss=1.5", "stall=-0.1", "delay_max_s=-1", "until_s=3", "from_s=4"];
    let sets = sets.map(|set| set.parse::<Setting>().unwrap());
    let errors = Layers::new().settings(&sets).parse::<Faults>().unwrap_err();
    let told: Vec<_> =
        errors.iter().map(|error| (error.place.to_string(), error.message.as_str())).collect();

    let expected = [
        ("--set delay_max_s=-1", "`delay_max_s` is -1, which is no length of time"),
        ("--set loss=1.5", "`loss` is 1.5, which is no probability"),
        ("--set stall=-0.1", "`stall` is -0.1, which is no probability"),
        ("--set until_s=3", "`until_s` is 3, but must be above `from_s`, which is 4"),
    ];
    assert_eq!(told, expected.map(|(place, message)| (place.to_owned(), message)));
    assert!(Faults { loss: f64::NAN, ..Faults::default() }.validate().is_err());
    assert_eq!(HARSH.validate(), Ok(()));
}
