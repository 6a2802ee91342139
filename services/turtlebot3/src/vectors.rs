//! Every packet of the vectors in `tests/data`, both directions.

use interfaces::Stamp;
use serde_json::Value;

use crate::lidar::{lds01, lds02};
use crate::link::Link;
use crate::packet::{Decoder, encode, instruction};
use crate::table::{self, BLOCK, ID, Reading, Words};
use node::deadman::Motion;

fn vectors() -> Value {
    serde_json::from_str(include_str!("../tests/data/turtlebot3_protocol.json")).unwrap()
}

/// The bytes of the vector called `name`.
fn bytes(name: &str) -> Vec<u8> {
    let vectors = vectors();
    let hex = vectors[name]["hex"].as_str().unwrap_or_else(|| panic!("no vector {name}"));
    let digits = hex.as_bytes().chunks(2);
    digits.map(|pair| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
}

fn packet(instruction: u8, parameters: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    encode(ID, instruction, &[parameters], &mut out);
    out
}

fn written(address: u16, data: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    Link::default().write(Stamp::ZERO, address, data, &mut out);
    out
}

fn read(address: u16, length: u16) -> Vec<u8> {
    let mut out = Vec::new();
    Link::default().read(Stamp::ZERO, address, length, &mut out);
    out
}

fn command(linear: f64, angular: f64) -> Vec<u8> {
    written(table::ADDRESS_COMMAND, &Words::nearest(Motion { linear, angular }).to_bytes())
}

#[test]
fn what_we_say_is_what_the_vectors_say() {
    let block = u16::try_from(BLOCK).unwrap();
    let stuffed = Words { linear: i32::from_le_bytes([0xff, 0xff, 0xfd, 0xff]), angular: 0 };
    let table = [
        ("ping", packet(instruction::PING, &[])),
        ("read_model_number", read(table::ADDRESS_MODEL_NUMBER, 2)),
        ("write_imu_recalibration", written(table::ADDRESS_IMU_RECALIBRATION, &[1])),
        ("write_heartbeat_0", written(table::ADDRESS_HEARTBEAT, &[0])),
        ("write_heartbeat_1", written(table::ADDRESS_HEARTBEAT, &[1])),
        ("write_heartbeat_255", written(table::ADDRESS_HEARTBEAT, &[255])),
        ("write_torque_on", written(table::ADDRESS_TORQUE, &[1])),
        ("write_torque_off", written(table::ADDRESS_TORQUE, &[0])),
        ("write_cmd_vel_0.22_0", command(0.22, 0.0)),
        ("write_cmd_vel_-0.10_1.00", command(-0.10, 1.0)),
        ("write_cmd_vel_0_-2.84", command(0.0, -2.84)),
        ("write_cmd_vel_stuffed", written(table::ADDRESS_COMMAND, &stuffed.to_bytes())),
        ("read_all", read(table::ADDRESS_BLOCK, block)),
        ("write_sound_1", written(table::ADDRESS_SOUND, &[1])),
    ];
    for (name, expected) in &table {
        assert_eq!(&bytes(name), expected, "{name}");
    }
    // None is forgotten: the others are answers, or a LiDAR's.
    let vectors = vectors();
    let names = vectors.as_object().unwrap().keys();
    let left = names.filter(|name| !table.iter().any(|(said, _)| said == name));
    let is_heard = |name: &&String| {
        name.ends_with("_reply") || name.starts_with("lds01") || name.starts_with("ld08")
    };
    let left: Vec<_> = left.filter(|name| !is_heard(name)).collect();
    assert_eq!(left, [""; 0], "vectors that nobody tests");
}

#[test]
fn what_is_answered_is_decoded_and_encoded_again() {
    let mut parsed: Vec<Vec<u8>> = Vec::new();
    let names = ["ping_reply", "read_model_number_reply", "write_ok_reply", "read_all_reply"];
    for name in names {
        let bytes = bytes(name);
        let mut decoder = Decoder::default();
        decoder.push(&bytes);
        let packet = decoder.decode().unwrap().unwrap();
        assert_eq!((packet.id, packet.instruction), (ID, instruction::STATUS), "{name}");
        let mut out = Vec::new();
        encode(packet.id, packet.instruction, &[packet.parameters], &mut out);
        assert_eq!(out, bytes, "{name}");
        parsed.push(packet.parameters.to_vec());
    }
    let model = table::MODEL_NUMBER.to_le_bytes();
    assert_eq!(parsed[0], [0, model[0], model[1], 5]);
    assert_eq!(parsed[1], [0, model[0], model[1]]);
    assert_eq!(parsed[2], [0]);
    assert_eq!(parsed[3].len(), 1 + BLOCK);
}

#[test]
fn the_block_says_what_its_note_says() {
    let mut decoder = Decoder::default();
    decoder.push(&bytes("read_all_reply"));
    let packet = decoder.decode().unwrap().unwrap();
    let reading = Reading::parse(packet.parameters[1..].try_into().unwrap());
    let [w, x, y, z] = reading.orientation.map(f64::from);
    let yaw = 2.0 * libm::atan2(z, w);

    assert_eq!((reading.millis, reading.heartbeat, reading.device_status), (123_456, 7, 0));
    assert!((reading.battery_voltage - 11.87).abs() < 1e-9, "{reading:?}");
    assert!((reading.battery_charge - 0.7611).abs() < 1e-9, "{reading:?}");
    assert_eq!(reading.angular_velocity.map(f32::to_bits), [0.0, 0.0, 0.25].map(f32::to_bits));
    assert!((reading.linear_acceleration[2] - 9.806_65).abs() < 1e-6, "{reading:?}");
    assert!((yaw - 1.0).abs() < 1e-6 && x.abs() < 1e-9 && y.abs() < 1e-9, "{reading:?}");
    assert_eq!((reading.current, reading.velocity), ([3, 4], [100, -100]));
    assert_eq!((reading.ticks, reading.has_torque), ([4096, -2048], true));
}

/// The index, counted counterclockwise, of ROBOTIS' driver, which is one degree off.
const DRIVER_OFF: usize = 1;

#[test]
fn an_lds_01_packet_has_the_ranges_that_the_vectors_say() {
    for name in ["lds01_captured_idx0", "lds01_idx0", "lds01_idx59"] {
        let packet = lds01::Packet::parse(bytes(name)[..].try_into().unwrap()).unwrap();
        let decoded = &vectors()[name]["decoded"];
        let rpm = decoded["rpm"].as_f64().unwrap();
        assert!((f64::from(packet.speed) / 10.0 - rpm).abs() < 1e-9, "{name}");
        for (ray, clockwise) in packet.rays.iter().zip(6 * usize::from(packet.index)..) {
            let exact = (360 - clockwise) % 360;
            let driver = (exact + 360 - DRIVER_OFF) % 360;
            let expected = &decoded["ranges_index_to_[m,intensity]"][driver.to_string()];
            let range = f64::from(ray.distance_mm) * 1e-3;
            assert!((range - expected[0].as_f64().unwrap()).abs() < 1e-9, "{name} {exact}");
            assert_eq!(u64::from(ray.intensity), expected[1].as_u64().unwrap(), "{name} {exact}");
        }
    }
}

#[test]
fn an_lds_02_packet_has_the_points_that_the_vectors_say() {
    for name in ["ld08_a", "ld08_wrap"] {
        let packet = lds02::Packet::parse(bytes(name)[..].try_into().unwrap()).unwrap();
        let decoded = &vectors()[name]["decoded"];
        let number = |key: &str| decoded[key].as_u64().unwrap();
        assert_eq!(u64::from(packet.speed), number("speed_deg_s"), "{name}");
        assert_eq!(u64::from(packet.start), number("start_cdeg"), "{name}");
        assert_eq!(u64::from(packet.end), number("end_cdeg"), "{name}");
        assert_eq!(u64::from(packet.timestamp), number("timestamp_ms"), "{name}");
        let points = decoded["points"].as_array().unwrap();
        assert_eq!(points.len(), packet.rays.len());
        for (index, (ray, point)) in packet.rays.iter().zip(points).enumerate() {
            let raw = packet.angle(index);
            assert!((raw - point["raw_cw_deg"].as_f64().unwrap()).abs() < 1e-9, "{name} {index}");
            assert_eq!(u64::from(ray.distance_mm), point["raw_mm"].as_u64().unwrap());
            assert_eq!(u64::from(ray.confidence), point["confidence"].as_u64().unwrap());
            let Some(degrees) = point["ccw_deg"].as_f64() else {
                assert_eq!(ray.distance_mm, 0, "{name} {index}");
                continue;
            };
            let (angle, range) = lds02::from_axis(raw, ray.distance_mm);
            assert!((angle.to_degrees() - degrees).abs() < 1e-3, "{name} {index}: {angle}");
            let expected = point["range_mm"].as_f64().unwrap() * 1e-3;
            assert!((range - expected).abs() < 2e-6, "{name} {index}: {range}");
        }
    }
}

// Broken on purpose: with only one of the checksum's two bytes, or with the CRC of another
// polynomial.
#[test]
fn with_any_bit_flipped_a_lidar_s_packet_is_none() {
    let lds_01 = bytes("lds01_idx0");
    let lds_02 = bytes("ld08_a");
    for bit in 0..lds_01.len() * 8 {
        let mut broken = lds_01.clone();
        broken[bit / 8] ^= 1 << (bit % 8);
        let packet = lds01::Packet::parse(broken[..].try_into().unwrap());
        // One of the checksum's two copies may be broken.
        assert_eq!(packet.is_some(), lds_01.len() - 2 <= bit / 8, "bit {bit}");
    }
    for bit in 0..lds_02.len() * 8 {
        let mut broken = lds_02.clone();
        broken[bit / 8] ^= 1 << (bit % 8);
        let packet = lds02::Packet::parse(broken[..].try_into().unwrap());
        assert_eq!(packet, None, "bit {bit}");
    }
}
