//! Whatever bytes arrive, no decoder fails, and each finds the next whole packet.

use std::time::Duration;

use interfaces::{LaserScan, Stamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::board::{Board, Wish};
use crate::lidar::{Heard, Lidar, Model, lds01, lds02};
use crate::link::Link;

/// [-] Rounds of each kind; `FUZZ_SAMPLES=10000000` makes it as many.
const ROUNDS: u64 = 20_000;

fn rounds() -> u64 {
    std::env::var("FUZZ_SAMPLES").map_or(ROUNDS, |text| text.parse().unwrap())
}

fn at(milliseconds: u64) -> Stamp {
    Stamp::ZERO.after(Duration::from_millis(milliseconds))
}

/// Bytes of no meaning, rich in what packets are made of.
fn noise(random: &mut ChaCha8Rng, length_max: usize) -> Vec<u8> {
    const BEGINNINGS: [u8; 9] = [0xff, 0xff, 0xfd, 0x00, 0xfa, 0xa0, 0x54, 0x2c, 0xc8];
    let length = random.next_u32() as usize % length_max;
    let byte = |_| {
        let draw = random.next_u32();
        if draw & 1 == 0 { draw.to_le_bytes()[1] } else { BEGINNINGS[(draw >> 8) as usize % 9] }
    };
    (0..length).map(byte).collect()
}

/// One turn of this LiDAR at its usual speed in a round room, the wall 1 m away.
pub(crate) fn turn(model: Model) -> Vec<Vec<u8>> {
    match model {
        Model::Lds01 => (0..60).map(lds_01_packet).collect(),
        Model::Lds02 => (0..20).map(lds_02_packet).collect(),
    }
}

fn lds_01_packet(index: u8) -> Vec<u8> {
    let mut bytes = vec![0xfa, 0xa0 + index, 0xb8, 0x0b];
    for _ in 0..6 {
        bytes.extend_from_slice(&[100, 0, 0xe8, 0x03, 0, 0]);
    }
    let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    bytes.extend_from_slice(&[0xff - sum; 2]);
    bytes
}

/// 18.0 degrees a packet, rays 1.5 degrees apart: 20 packets a turn.
fn lds_02_packet(index: u16) -> Vec<u8> {
    let start = 1_800 * index;
    let mut bytes = vec![0x54, 0x2c, 0x10, 0x0e];
    bytes.extend_from_slice(&start.to_le_bytes());
    for _ in 0..12 {
        bytes.extend_from_slice(&[0xe8, 0x03, 200]);
    }
    bytes.extend_from_slice(&(start + 1_650).to_le_bytes());
    bytes.extend_from_slice(&[0, 0]);
    bytes.push(crc_8(&bytes));
    bytes
}

/// By the textbook's long division, a bit at a time.
fn crc_8(bytes: &[u8]) -> u8 {
    let mut rest = 0_u32;
    for &byte in bytes.iter().chain(&[0]) {
        for bit in (0..8).rev() {
            rest = (rest << 1) | u32::from(byte >> bit & 1);
            if 0x100 <= rest {
                rest ^= 0x14d;
            }
        }
    }
    u8::try_from(rest).unwrap()
}

/// How many turns and packets come of this.
fn count(lidar: &mut Lidar, bytes: &[u8]) -> (u32, u32) {
    lidar.hear(at(1_000), bytes);
    let (mut turns, mut packets) = (0, 0);
    let mut scan = LaserScan::default();
    while let Some(heard) = lidar.decode() {
        match heard {
            Heard::Garbage => {}
            Heard::Packet => packets += 1,
            Heard::Turn(turn) => {
                packets += 1;
                turns += 1;
                turn.fill(Model::Lds01, 0.12, turn.points.len(), &mut scan);
                assert!(scan.ranges().iter().all(|range| range.is_nan() || 0.12 <= *range));
            }
        }
    }
    (turns, packets)
}

#[test]
fn a_lidar_in_noise_is_heard_from_the_next_packet_on() {
    for model in Model::ALL {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let whole = turn(model);
        let mut lidar = Lidar::new(model, true);
        for round in 0..rounds() {
            count(&mut lidar, &noise(&mut random, 200));
            // A false beginning in the noise swallows one packet at the most.
            let (_, first) = count(&mut lidar, &whole[0]);
            let (_, second) = count(&mut lidar, &whole[1]);
            assert!(1 <= first + second, "{model:?} round {round}");
        }
    }
}

#[test]
fn a_lidar_s_stream_in_pieces_with_packets_missing_and_damaged_is_never_taken_for_more() {
    for model in Model::ALL {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let whole = turn(model);
        let mut lidar = Lidar::new(model, true);
        let (mut sent, mut told, mut damaged) = (0, 0, 0);
        for _ in 0..rounds() / 50 {
            let mut bytes = Vec::new();
            for packet in &whole {
                match random.next_u32() % 40 {
                    0 => damaged += 1,
                    1 => {
                        let mut broken = packet.clone();
                        broken[2] ^= 0x11;
                        bytes.extend(broken);
                        damaged += 1;
                    }
                    _ => bytes.extend(packet),
                }
            }
            sent += 1;
            for piece in bytes.chunks(1 + random.next_u32() as usize % 60) {
                told += count(&mut lidar, piece).0;
            }
        }
        println!("{model:?}: {told} of {sent} turns, {damaged} packets damaged or lost");
        assert!(told <= sent && sent * 9 / 10 < told, "{model:?}: {told} of {sent}");
    }
}

#[test]
fn the_board_in_noise_never_says_anything() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut board = Board::new(Duration::from_millis(10), true);
    let mut now = Stamp::ZERO;
    for round in 0..rounds() {
        now = now.after(Duration::from_millis(u64::from(random.next_u32() % 20)));
        board.hear(&noise(&mut random, 300));
        let mut out = Vec::new();
        while let Some(event) = board.turn(now, &Wish::default(), &mut out) {
            let is_lost = matches!(event, crate::board::Event::Lost(_));
            assert!(is_lost, "round {round}: {event:?}");
            board.reset();
        }
    }
}

#[test]
fn a_link_ends_every_transaction_whatever_comes() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut link = Link::default();
    for round in 0..rounds() {
        link.read(at(0), 10, 172, &mut Vec::new());
        link.hear(&noise(&mut random, 300));
        if let Some(ended) = link.end(at(10)) {
            panic!("round {round}: {ended:?}");
        }
        assert!(link.end(at(50)).is_some(), "round {round}");
    }
}

#[test]
fn every_packet_of_random_contents_is_parsed_or_refused() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..rounds() {
        let mut lds_01 = [0; 42];
        random.fill_bytes(&mut lds_01);
        lds_01[0] = 0xfa;
        let sum = lds_01[..40].iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        lds_01[40] = 0xff - sum;
        let is_index = (0xa0..=0xdb).contains(&lds_01[1]);
        assert_eq!(lds01::Packet::parse(&lds_01).is_some(), is_index);

        let mut lds_02 = [0; 47];
        random.fill_bytes(&mut lds_02);
        lds_02[..2].copy_from_slice(&[0x54, 0x2c]);
        lds_02[46] = crc_8(&lds_02[..46]);
        if let Some(packet) = lds02::Packet::parse(&lds_02) {
            assert!((0..12).all(|ray| (0.0..360.0).contains(&packet.angle(ray))), "{packet:?}");
        }
        let mut lidar = Lidar::new(Model::Lds02, true);
        count(&mut lidar, &lds_02);
        let mut lidar = Lidar::new(Model::Lds01, false);
        count(&mut lidar, &lds_01);
    }
}
