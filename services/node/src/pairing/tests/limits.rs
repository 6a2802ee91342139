//! What Teseo adds: reasons, age, delay, and clocks that run backwards.

use std::time::Duration;

use interfaces::Stamp;

use super::super::{Bounds, Config, ConfigError, Entry, Outcome, Pairing, Policy, Reason};
use super::streams::{MILLISECOND, Random};

const A: usize = 0;
const B: usize = 1;

const LIMITED: Config = Config {
    policy: Policy::Nearest,
    topics: 2,
    queue_size: 10,
    slop: Duration::from_millis(20),
    bounds: Bounds::Limited {
        max_age: Duration::from_millis(200),
        max_delay: Duration::from_millis(30),
    },
};

const ADAPTIVE: Config = Config { policy: Policy::ADAPTIVE, ..LIMITED };

const UNLIMITED: Config = Config { bounds: Bounds::Unlimited, ..LIMITED };

fn millis(millis: u64) -> Stamp {
    Stamp::from_nanoseconds(millis * MILLISECOND)
}

/// Pushes a sample, both times in ms, and tells the outcome: `100+105` is a pair of a's 100 and b's
/// 105, `b105 no_partner` a drop.
fn push(pairing: &mut Pairing, received: u64, topic: usize, stamp: u64) -> String {
    let (stamp, received) = (millis(stamp), millis(received));
    told(pairing.push(topic, Entry { stamp, received, ..Entry::default() }))
}

fn told(outcome: Outcome<'_>) -> String {
    let in_millis = |entry: &Entry| (entry.stamp.nanoseconds / MILLISECOND).to_string();
    let dropped = outcome.dropped().iter().map(|it| {
        let topic = if it.topic == A { 'a' } else { 'b' };
        format!("{topic}{} {}", in_millis(&it.entry), it.reason.label())
    });
    let pairs = outcome
        .pairs()
        .map(|pair| pair.members.iter().map(in_millis).collect::<Vec<_>>().join("+"));
    dropped.chain(pairs).collect::<Vec<_>>().join(", ")
}

/// Pushes what arrives at these times, topics and stamps, and expects each outcome.
#[track_caller]
fn expect(pairing: &mut Pairing, steps: &[(u64, usize, u64, &str)]) {
    for &(received, topic, stamp, expected) in steps {
        assert_eq!(push(pairing, received, topic, stamp), expected, "{stamp} at {received}");
    }
    for topic in [A, B] {
        assert!(pairing.books(topic).close());
    }
}

#[test]
fn stamps_exactly_the_slop_apart_do_not_pair() {
    for config in [LIMITED, ADAPTIVE] {
        let mut pairing = Pairing::new(&config).unwrap();
        push(&mut pairing, 1, A, 100);
        push(&mut pairing, 1, B, 120);
        assert_eq!(told(pairing.poll(millis(100))).matches('+').count(), 0);

        let mut pairing = Pairing::new(&config).unwrap();
        let first = push(&mut pairing, 1, A, 100) + &push(&mut pairing, 1, B, 119);
        assert_eq!(first + &told(pairing.poll(millis(100))), "100+119");
    }
}

#[test]
fn a_sample_whose_time_has_passed_had_no_partner() {
    let mut pairing = Pairing::new(&LIMITED).unwrap();
    expect(
        &mut pairing,
        &[
            (0, B, 100, ""),
            (50, A, 150, ""),
            (50, B, 150, "150+150"),
            // Not too old: a went past 120 long ago.
            (201, A, 300, "b100 no_partner"),
        ],
    );
}

#[test]
fn a_sample_whose_partner_is_silent_becomes_too_old() {
    for config in [LIMITED, ADAPTIVE] {
        let mut pairing = Pairing::new(&config).unwrap();
        expect(&mut pairing, &[(0, A, 100, ""), (200, A, 300, "")]);
        assert_eq!(told(pairing.poll(millis(201))), "a100 too_old");
    }
}

#[test]
fn a_sample_whose_partner_went_to_another_is_superseded() {
    let mut pairing = Pairing::new(&LIMITED).unwrap();
    expect(
        &mut pairing,
        &[(0, B, 95, ""), (0, B, 105, ""), (0, A, 104, "104+105"), (201, A, 300, "b95 superseded")],
    );

    let mut pairing = Pairing::new(&ADAPTIVE).unwrap();
    expect(
        &mut pairing,
        &[(0, A, 95, ""), (0, B, 105, ""), (0, A, 104, "a95 superseded"), (1, A, 150, "104+105")],
    );
}

#[test]
fn a_full_queue_drops_what_might_still_have_paired() {
    for config in [LIMITED, ADAPTIVE] {
        let mut pairing = Pairing::new(&Config { queue_size: 2, ..config }).unwrap();
        expect(&mut pairing, &[(0, A, 100, ""), (1, A, 110, ""), (2, A, 120, "a100 overflow")]);
    }
}

#[test]
fn a_full_queue_takes_nothing_that_is_older_than_all_it_holds() {
    let mut pairing = Pairing::new(&Config { queue_size: 2, ..UNLIMITED }).unwrap();
    expect(&mut pairing, &[(0, A, 100, ""), (1, A, 110, ""), (2, A, 50, "a50 out_of_order")]);
}

#[test]
fn a_later_sample_with_the_same_stamp_replaces_the_first() {
    let mut pairing = Pairing::new(&LIMITED).unwrap();
    expect(&mut pairing, &[(0, A, 100, ""), (1, A, 100, "a100 replaced"), (2, B, 100, "100+100")]);
}

#[test]
fn adaptive_does_not_guess_who_was_the_partner_of_a_lost_sample() {
    let mut pairing = Pairing::new(&Config { queue_size: 1, ..ADAPTIVE }).unwrap();
    expect(
        &mut pairing,
        &[(0, B, 100, ""), (1, B, 110, "b100 overflow"), (2, A, 99, "a99 partner_lost")],
    );
}

#[test]
fn a_stamp_beyond_every_clock_is_refused() {
    let mut pairing = Pairing::new(&LIMITED).unwrap();
    let entry = Entry { stamp: Stamp::from_nanoseconds(u64::MAX), ..Entry::default() };
    assert_eq!(pairing.push(A, entry).dropped()[0].reason, Reason::NoStamp);
    expect(&mut pairing, &[(0, A, 100, ""), (0, B, 100, "100+100")]);
}

#[test]
fn a_set_goes_out_when_its_delay_is_up() {
    let mut pairing = Pairing::new(&ADAPTIVE).unwrap();
    expect(&mut pairing, &[(0, A, 100, ""), (10, B, 101, "")]);

    assert_eq!(pairing.next_deadline(), Some(millis(40)));
    assert_eq!(told(pairing.poll(millis(39))), "");
    assert_eq!(told(pairing.poll(millis(40))), "100+101");
    assert_eq!(pairing.next_deadline(), None);
    assert_eq!(pairing.forced(), 1);
}

#[test]
fn a_better_set_does_not_prolong_the_delay() {
    let mut pairing = Pairing::new(&ADAPTIVE).unwrap();
    expect(&mut pairing, &[(0, A, 100, ""), (10, B, 115, ""), (20, A, 112, "a100 superseded")]);
    assert_eq!(pairing.next_deadline(), Some(millis(40)));
    assert_eq!(told(pairing.poll(millis(40))), "112+115");
}

#[test]
fn another_set_takes_the_place_of_one_that_becomes_too_old() {
    let mut pairing = Pairing::new(&ADAPTIVE).unwrap();
    expect(&mut pairing, &[(0, A, 110, ""), (30, A, 118, ""), (190, B, 100, "")]);

    let too_old = millis(200).after(Duration::from_nanos(1));
    assert_eq!(pairing.next_deadline(), Some(too_old));
    assert_eq!(told(pairing.poll(too_old)), "a110 too_old");
    assert_eq!(pairing.next_deadline(), Some(millis(220)));
    assert_eq!(told(pairing.poll(millis(220))), "118+100");
}

#[test]
fn without_any_delay_the_best_so_far_goes_out_at_once() {
    let Bounds::Limited { max_age, .. } = LIMITED.bounds else { unreachable!() };
    let bounds = Bounds::Limited { max_age, max_delay: Duration::ZERO };
    let mut pairing = Pairing::new(&Config { bounds, ..ADAPTIVE }).unwrap();
    expect(
        &mut pairing,
        &[(0, A, 90, ""), (0, A, 100, ""), (1, B, 101, "a90 superseded, 100+101")],
    );
}

#[test]
fn one_absurd_stamp_costs_the_other_topic_nothing() {
    let mut pairing = Pairing::new(&LIMITED).unwrap();
    expect(
        &mut pairing,
        &[
            (0, A, 100, ""),
            (0, B, 100, "100+100"),
            (50, A, 99_999, ""),
            (50, B, 150, ""),
            (60, A, 150, "a99999 reset, 150+150"),
        ],
    );
    assert_eq!(pairing.resets(), 1);
}

#[test]
fn one_absurd_stamp_costs_nothing_where_the_other_topic_is_served_sooner() {
    let mut pairing = Pairing::new(&LIMITED).unwrap();
    expect(
        &mut pairing,
        &[
            (1_000, B, 1_000, ""),
            (1_052, A, 1_000, "1000+1000"),
            (1_102, A, 99_999, ""),
            (1_103, B, 1_100, ""),
            (1_150, B, 1_150, ""),
            // b is ahead of it by more than the slop, but not by as much as the step.
            (1_152, A, 1_100, "a99999 reset, 1100+1100"),
            (1_202, A, 1_150, "1150+1150"),
        ],
    );
}

#[test]
fn a_topic_is_believed_as_soon_as_the_other_has_returned_from_a_false_clock() {
    let mut pairing = Pairing::new(&LIMITED).unwrap();
    expect(
        &mut pairing,
        &[
            (1_000, B, 1_000, ""),
            (1_048, A, 1_000, "1000+1000"),
            (1_050, B, 1_050, ""),
            (1_098, A, 1, "b1050 reset"),
            (1_100, B, 1_100, "b1100 reset"),
            (1_148, A, 1_100, ""),
            // Still ahead of a, which is served later.
            (1_150, B, 1_150, ""),
            (1_198, A, 1_150, "1150+1150"),
        ],
    );
}

#[test]
fn what_comes_late_from_before_a_step_back_is_dropped() {
    let cases =
        [(LIMITED, "", "a5000 reset, b4900 reset"), (ADAPTIVE, "b4900 no_partner", "a5000 reset")];
    for (config, before, at_the_step) in cases {
        let mut pairing = Pairing::new(&config).unwrap();
        expect(
            &mut pairing,
            &[
                (0, B, 4_900, ""),
                (0, A, 5_000, before),
                (50, A, 0, at_the_step),
                (60, B, 5_000, "b5000 reset"),
            ],
        );
        let met = push(&mut pairing, 110, B, 1) + &told(pairing.poll(millis(140)));
        assert_eq!(met, "0+1");
        assert_eq!(pairing.resets(), 1);
    }
}

#[test]
fn a_set_is_not_lost_to_the_step_back_that_ends_its_wait() {
    let mut pairing = Pairing::new(&ADAPTIVE).unwrap();
    expect(&mut pairing, &[(0, A, 5_000, ""), (0, B, 5_001, ""), (10, A, 0, "5000+5001")]);
}

#[test]
fn two_small_steps_back_in_a_row_are_a_clock_that_runs_backwards() {
    let mut pairing = Pairing::new(&ADAPTIVE).unwrap();
    expect(
        &mut pairing,
        &[
            (0, A, 100, ""),
            (1, A, 90, "a90 out_of_order"),
            (2, A, 110, ""),
            (3, A, 95, "a95 out_of_order"),
            (4, A, 96, "a100 reset, a110 reset"),
        ],
    );
    assert_eq!(pairing.resets(), 1);
}

#[test]
fn without_limits_nothing_resets_as_in_ros_2() {
    let mut pairing = Pairing::new(&Config { queue_size: 1, ..UNLIMITED }).unwrap();
    expect(
        &mut pairing,
        &[
            (0, A, 9_000, ""),
            (1, A, 0, "a0 out_of_order"),
            (2, B, 0, ""),
            (3, A, 1, "a1 out_of_order"),
        ],
    );
    assert_eq!(pairing.resets(), 0);
}

#[test]
fn a_clock_that_runs_backwards_costs_at_most_two_periods() {
    const PERIOD: u64 = 50;
    for seed in 0..5_000 {
        let mut random = Random::new(seed);
        let config = Config {
            queue_size: random.choose(&[3, 10]),
            slop: Duration::from_millis(random.choose(&[11, 20, 45])),
            ..random.choose(&[LIMITED, ADAPTIVE])
        };
        let mut pairing = Pairing::new(&config).unwrap();
        let slop = u64::try_from(config.slop.as_millis()).unwrap();
        let back = slop + 1 + random.below(20_000);
        let step_at = 30_000 + random.below(1_500);

        let mut arrivals = Vec::new();
        for topic in [A, B] {
            let (offset, latency) = (random.below(6), random.below(PERIOD));
            for number in 0..60 {
                let time = 29_000 + offset + number * PERIOD + random.below(5);
                let stamp = if time < step_at { time } else { time - back };
                arrivals.push((time + latency, topic, stamp));
            }
        }
        arrivals.sort_unstable();

        let mut given_out = Vec::new();
        for (received, topic, stamp) in arrivals {
            while let Some(due) = pairing.next_deadline().filter(|&due| due <= millis(received)) {
                let pairs = pairing.poll(due).pairs().count();
                given_out.extend((0..pairs).map(|_| due.nanoseconds / MILLISECOND));
            }
            let pairs = push(&mut pairing, received, topic, stamp).matches('+').count();
            given_out.extend((0..pairs).map(|_| received));
        }
        let gaps = given_out.windows(2).map(|pairs| pairs[1] - pairs[0]);
        let silence = gaps.max().unwrap();
        // Meanwhile the clock went on by a period; a stamp that is hardly behind shows no step.
        assert!(0 < pairing.resets() || back < slop + PERIOD + 5, "SEED={seed}");
        assert!(silence <= 3 * PERIOD, "SEED={seed}: silent for {silence} ms");
    }
}

#[test]
fn a_configuration_that_cannot_work_is_refused() {
    let limited = |max_age, max_delay| Bounds::Limited {
        max_age: Duration::from_millis(max_age),
        max_delay: Duration::from_millis(max_delay),
    };
    let nan = Policy::Adaptive { age_penalty: f64::NAN, period_min: [Duration::ZERO; _] };
    let cases = [
        (Config { topics: 1, ..LIMITED }, ConfigError::Topics),
        (Config { topics: 9, ..LIMITED }, ConfigError::Topics),
        (Config { queue_size: 0, ..LIMITED }, ConfigError::QueueSize),
        (Config { queue_size: 100_000, ..LIMITED }, ConfigError::QueueSize),
        (Config { slop: Duration::ZERO, ..LIMITED }, ConfigError::Slop),
        (Config { slop: Duration::MAX, ..LIMITED }, ConfigError::Slop),
        (Config { policy: nan, ..LIMITED }, ConfigError::AgePenalty),
        (Config { bounds: limited(0, 0), ..LIMITED }, ConfigError::MaxAge),
        (Config { bounds: limited(1_000_000, 0), ..LIMITED }, ConfigError::MaxAge),
        (Config { bounds: limited(100, 101), ..LIMITED }, ConfigError::MaxDelay),
        (Config { topics: 8, ..LIMITED }, ConfigError::Combinations),
    ];
    for (config, expected) in cases {
        assert_eq!(Pairing::new(&config).err(), Some(expected), "{config:?}");
    }
}
