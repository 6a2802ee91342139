//! The emulator by itself against the protocol's vectors, which the bridge is held to as well.

use std::time::Duration;

use interfaces::Stamp;
use serde_json::Value;

use crate::bus::{Asked, Receiver, answer};
use crate::firmware::{Body, Firmware};
use crate::{lds01, lds02};

const BODY: Body = Body { heading: 0.0, turning: 0.0, voltage: 12.0, button: false };

/// The bytes of the vector called `name`.
pub(crate) fn bytes(name: &str) -> Vec<u8> {
    let text = include_str!("../../turtlebot3/tests/data/turtlebot3_protocol.json");
    let vectors: Value = serde_json::from_str(text).unwrap();
    let hex = vectors[name]["hex"].as_str().unwrap_or_else(|| panic!("no vector {name}"));
    let digits = hex.as_bytes().chunks(2);
    digits.map(|pair| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
}

fn asked(name: &str) -> Asked {
    let mut receiver = Receiver::default();
    receiver.push(&bytes(name));
    receiver.next().unwrap_or_else(|| panic!("{name} asks nothing"))
}

fn command(words: [(usize, [u8; 4]); 2]) -> Asked {
    let mut data = vec![0; 24];
    for (at, word) in words {
        data[at..at + 4].copy_from_slice(&word);
    }
    Asked::Write { address: 150, data }
}

#[test]
fn what_a_bridge_says_is_understood() {
    let write = |address, data: &[u8]| Asked::Write { address, data: data.to_vec() };
    let speeds = |linear: i32, angular: i32| {
        command([(0, linear.to_le_bytes()), (20, angular.to_le_bytes())])
    };
    let table = [
        ("ping", Asked::Ping),
        ("read_model_number", Asked::Read { address: 0, length: 2 }),
        ("write_imu_recalibration", write(59, &[1])),
        ("write_heartbeat_0", write(19, &[0])),
        ("write_heartbeat_1", write(19, &[1])),
        ("write_heartbeat_255", write(19, &[255])),
        ("write_torque_on", write(149, &[1])),
        ("write_torque_off", write(149, &[0])),
        ("write_cmd_vel_0.22_0", speeds(22, 0)),
        ("write_cmd_vel_-0.10_1.00", speeds(-10, 100)),
        ("write_cmd_vel_0_-2.84", speeds(0, -284)),
        ("write_cmd_vel_stuffed", command([(0, [0xff, 0xff, 0xfd, 0xff]), (20, [0; 4])])),
        ("read_all", Asked::Read { address: 10, length: 172 }),
        ("write_sound_1", write(50, &[1])),
    ];
    for (name, expected) in table {
        assert_eq!(asked(name), expected, "{name}");
    }
}

#[test]
fn what_the_board_answers_is_what_the_vectors_say() {
    let now = Stamp::from_nanoseconds(1);
    for name in ["ping", "read_model_number"] {
        let mut board = Firmware::new(now, Duration::ZERO);
        let said = board.turn(now, &bytes(name), &BODY);
        assert_eq!(said, bytes(&format!("{name}_reply")), "{name}");
    }
    for name in ["write_heartbeat_0", "write_torque_on", "write_cmd_vel_0.22_0", "write_sound_1"] {
        let mut board = Firmware::new(now, Duration::ZERO);
        assert_eq!(board.turn(now, &bytes(name), &BODY), bytes("write_ok_reply"), "{name}");
    }
    // The block, put together from its vector's parts.
    let whole = bytes("read_all_reply");
    let data = &whole[9..whole.len() - 2];
    assert_eq!(data.len(), 172);
    assert_eq!(answer(0, data), whole);
}

#[test]
fn lidars_say_what_the_vectors_say() {
    let millimetres = |range: u16| range;
    let rays: Vec<_> = (0..6).map(|ray| (1_000 + ray, millimetres(500 + ray))).collect();
    assert_eq!(lds01::packet(0, 3_000, &rays.try_into().unwrap()), bytes("lds01_idx0"));
    let far = [(0, 0), (7, 119), (65_535, 120), (1, 3_500), (2, 3_501), (3, 65_535)];
    assert_eq!(lds01::packet(59, 2_998, &far), bytes("lds01_idx59"));

    let rays: Vec<_> = (0..12_u8).map(|ray| (1_000 + 10 * u16::from(ray), 200 + ray)).collect();
    let rays = rays.try_into().unwrap();
    assert_eq!(lds02::packet(3_600, 0, 1_722, 100, &rays), bytes("ld08_a"));
    let mut wrap = [(500, 200); 12];
    wrap[..4].copy_from_slice(&[(0, 0), (160, 228), (8_000, 228), (65_535, 1)]);
    assert_eq!(lds02::packet(3_600, 35_500, 1_222, 29_999, &wrap), bytes("ld08_wrap"));
}
