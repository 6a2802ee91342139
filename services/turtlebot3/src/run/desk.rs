//! The board's port: opened, spoken to, and told to the robot's topics.

use std::time::Duration;

use interfaces::topics::{BATTERY_STATE, BOARD_REQUEST, IMU, JOINT_STATES, SENSOR_STATE};
use interfaces::{BatteryState, BoardRequest, Imu, JointState, SensorState, Stamp};
use node::{Gauge, Latency, Node, Publisher, Result, Subscriber};

use super::PIECE;
use super::told::Told;
use crate::Config;
use crate::board::{Board, CALIBRATION_MAX, Event, Sound, Wish};
use crate::board_clock;
use crate::encoders::Encoders;
use crate::serial::{Line, Refusal};
use crate::table::{Reading, Words};

/// [bit/s] What TurtleBot3's own node sets; over USB it makes no difference.
const BAUD_RATE: u32 = 1_000_000;

/// Between two words about the battery.
const BATTERY_PERIOD: Duration = Duration::from_secs(1);

/// Between two words about buttons and motors where none of them changes.
const SENSOR_PERIOD: Duration = Duration::from_millis(100);

/// [V] Below this the board's lamp lights; below 11.0 V it cuts the motors' power.
const BATTERY_LOW: f64 = 11.1;

/// [V] A battery that is said to be low is not until it is well above.
const BATTERY_WELL: f64 = 11.4;

/// One's dealings with the board.
pub(super) struct BoardDesk {
    line: Line,
    told: Told,
    board: Board,
    encoders: Encoders,
    out: Vec<u8>,
    has_drive: bool,
    has_torque: bool,
    /// What the motors were asked for last: to hold the wheels, or to let them go.
    torque_asked: Option<bool>,
    is_low: bool,
    firmware: u8,
    battery_due: Stamp,
    sensor_due: Stamp,
    sensors_told: SensorState,
    topics: Topics,
    figures: Figures,
}

struct Topics {
    joints: Publisher<JointState>,
    imu: Publisher<Imu>,
    battery: Publisher<BatteryState>,
    sensors: Publisher<SensorState>,
    requests: Subscriber<BoardRequest>,
}

struct Figures {
    battery: Gauge,
    garbage: Gauge,
    way: Latency,
    answer: Latency,
}

impl BoardDesk {
    pub(super) fn new(node: &mut Node<'_>, config: &Config) -> Result<Self> {
        // A robot that was started before may be in motion, and its gyro is calibrated.
        let calibrates = config.calibrates_gyro && node.settings().epoch() == 1;
        Ok(Self {
            line: Line::new(&config.board_port, "board_port"),
            told: Told::new(node, "OpenCR", "board_losses"),
            board: Board::new(config.read_period(), calibrates),
            encoders: Encoders::default(),
            out: Vec::with_capacity(PIECE),
            has_drive: false,
            has_torque: true,
            torque_asked: None,
            is_low: false,
            firmware: 0,
            battery_due: Stamp::ZERO,
            sensor_due: Stamp::ZERO,
            sensors_told: SensorState::default(),
            topics: Topics {
                joints: node.publish(&JOINT_STATES)?,
                imu: node.publish_on_event(&IMU)?,
                battery: node.publish_on_event(&BATTERY_STATE)?,
                sensors: node.publish_on_event(&SENSOR_STATE)?,
                requests: node.subscribe(&BOARD_REQUEST)?,
            },
            figures: Figures {
                battery: node.gauge("battery_v"),
                garbage: node.gauge("board_garbage"),
                way: node.latency("bytes_to_joints"),
                answer: node.latency("board_answer"),
            },
        })
    }

    /// Opens the port, if it is time to try.
    fn open(&mut self, node: &Node<'_>, now: Stamp) -> std::result::Result<(), Refusal> {
        match self.line.open(now, BAUD_RATE) {
            None => {}
            Some(Err(refusal)) => return Err(refusal),
            Some(Ok(file)) => {
                if let Err(cause) = node.watch(file) {
                    tracing::debug!(%cause, "reads the board by the clock");
                }
                self.board.reset();
                // Whoever drove before may have died in motion.
                self.stop();
            }
        }
        Ok(())
    }

    /// Nobody has listened for a while.
    pub(super) fn restart(&mut self) {
        self.line.close(Stamp::ZERO);
        self.has_drive = false;
    }

    /// Whether the wheels can be reached and have power.
    pub(super) fn has_drive(&self) -> bool {
        self.has_drive
    }

    /// Whether the board was told to stand, and has said that it heard, or cannot be told anything.
    pub(super) fn stands(&self) -> bool {
        !self.line.is_open() || self.board.stands()
    }

    /// What it was told last.
    pub(super) fn asked(&self) -> Words {
        self.board.asked()
    }

    pub(super) fn due(&self, wish: &Wish) -> Option<Stamp> {
        self.line.due().or_else(|| Some(self.board.due(wish)))
    }

    /// Hears what has come from the port, and who asks the board for something.
    pub(super) fn listen(&mut self, node: &mut Node<'_>, now: Stamp) -> Result {
        while let Some(request) = self.topics.requests.receive()? {
            self.ask(&request);
        }
        if let Err(refusal) = self.open(node, now) {
            self.told.closed(node, &refusal);
        }
        let mut piece = [0; PIECE];
        loop {
            match self.line.read(&mut piece) {
                Ok(0) => return Ok(()),
                Ok(count) => self.board.hear(&piece[..count]),
                Err(gone) => {
                    self.lose(node, now, &gone.to_string());
                    return Ok(());
                }
            }
        }
    }

    fn ask(&mut self, request: &BoardRequest) {
        const SOUNDS: [Sound; 6] = [
            Sound::Off,
            Sound::On,
            Sound::LowBattery,
            Sound::Error,
            Sound::Button1,
            Sound::Button2,
        ];
        if request.asks_sound == 1
            && let Some(&sound) = SOUNDS.get(usize::from(request.sound))
        {
            self.board.play(sound);
        }
        if request.asks_torque == 1 {
            let on = request.torque == 1;
            self.torque_asked = Some(on);
            self.board.set_torque(on);
        }
    }

    /// Says to the board what is due, and to the topics what the board has said.
    pub(super) fn turn(&mut self, node: &mut Node<'_>, now: Stamp, wish: &Wish) -> Result {
        if !self.line.is_open() {
            return Ok(());
        }
        self.out.clear();
        while let Some(event) = self.board.turn(now, wish, &mut self.out) {
            match event {
                Event::Greeted { model, firmware } => {
                    self.firmware = firmware;
                    tracing::info!(model, firmware, "found the OpenCR");
                }
                Event::Calibrating => {
                    node.extend_timeout(CALIBRATION_MAX);
                    node.say("OpenCR: measures its gyro's bias; the robot must not be moved");
                }
                Event::Calibrated => node.say("OpenCR: knows its gyro's bias"),
                Event::Read(reading, told) => self.tell(node, now, &reading, told)?,
                Event::Lost(loss) => {
                    self.lose(node, now, &loss.to_string());
                    return Ok(());
                }
            }
        }
        self.figures.garbage.set(self.board.garbage() as f64);
        if let Err(gone) = self.line.write(&self.out) {
            self.lose(node, now, &gone.to_string());
        }
        Ok(())
    }

    fn tell(
        &mut self,
        node: &mut Node<'_>,
        now: Stamp,
        reading: &Reading,
        told: board_clock::Told,
    ) -> Result {
        let stamp = match told {
            board_clock::Told::Same => return Ok(()),
            board_clock::Told::New(stamp) => stamp,
            board_clock::Told::Restarted(stamp) => {
                tracing::warn!("the OpenCR was started anew");
                self.torque_asked = None;
                self.encoders.rebase();
                stamp
            }
        };
        // The IMU first: who reads both finds it when the wheels come.
        self.topics.imu.send_with(|imu| fill_imu(stamp, reading, imu))?;
        let encoders = &mut self.encoders;
        self.topics.joints.send_with(|joints| {
            joints.header.stamp = stamp;
            encoders.update(reading.ticks, reading.velocity, joints);
        })?;
        self.figures.way.record(node::clock::now().since(now));
        self.figures.answer.record(now.since(stamp));
        self.tell_sensors(now, stamp, reading)?;
        self.tell_battery(node, now, stamp, reading)?;
        self.judge(node, reading);
        Ok(())
    }

    fn tell_sensors(&mut self, now: Stamp, stamp: Stamp, reading: &Reading) -> Result {
        let flags = |flags: [bool; 2]| flags.map(u8::from);
        let sensors = SensorState {
            bumper: flags(reading.bumpers),
            button: flags(reading.buttons),
            torque: u8::from(reading.has_torque),
            motors: u8::from(reading.device_status == 0),
            firmware: self.firmware,
            ..SensorState::default()
        };
        if sensors == self.sensors_told && now < self.sensor_due {
            return Ok(());
        }
        self.sensors_told = sensors;
        self.sensor_due = now.after(SENSOR_PERIOD);
        self.topics.sensors.send_with(|sample| {
            *sample = sensors;
            sample.header.stamp = stamp;
            sample.encoder_ticks = reading.ticks;
            sample.motor_current = reading.current;
        })
    }

    fn tell_battery(
        &mut self,
        node: &mut Node<'_>,
        now: Stamp,
        stamp: Stamp,
        reading: &Reading,
    ) -> Result {
        if now < self.battery_due {
            return Ok(());
        }
        self.battery_due = now.after(BATTERY_PERIOD);
        let voltage = reading.battery_voltage;
        self.figures.battery.set(voltage);
        let was_low = self.is_low;
        self.is_low = voltage < if was_low { BATTERY_WELL } else { BATTERY_LOW };
        if self.is_low && !was_low {
            tracing::warn!(voltage, "the battery is low");
            node.say(&format!("battery low, {voltage:.2} V: below 11.0 V the motors lose power"));
            self.board.play(Sound::LowBattery);
        }
        self.topics.battery.send_with(|battery| {
            battery.header.stamp = stamp;
            battery.voltage = voltage;
            battery.percentage = reading.battery_charge;
        })
    }

    /// Whether the wheels can be driven.
    fn judge(&mut self, node: &mut Node<'_>, reading: &Reading) {
        let has_torque = reading.device_status == 0 && reading.has_torque;
        self.has_drive = has_torque;
        if has_torque {
            self.told.well(node, "the motors have power");
        } else if self.has_torque && reading.device_status != 0 {
            self.told.lost(node, "the board finds no motors: look at their cables, then reset it");
        } else if self.has_torque && self.torque_asked == Some(false) {
            self.told.trouble(
                node,
                "the motors let the wheels go, as was asked: teseo topic pub board_request \
                 asks_torque=1 torque=1",
            );
        } else if self.has_torque {
            self.told
                .lost(node, "the motors have no power: charge the battery, or reset the board");
        }
        self.has_torque = has_torque;
    }

    /// Stops the wheels, where the board still hears, without waiting for a word of it.
    fn stop(&mut self) {
        self.out.clear();
        Board::farewell(&mut self.out);
        // Who has gone has gone.
        let _ = self.line.write(&self.out);
        self.out.clear();
    }

    fn lose(&mut self, node: &mut Node<'_>, now: Stamp, why: &str) {
        self.stop();
        self.line.close(now);
        self.has_drive = false;
        self.told.lost(node, why);
    }
}

fn fill_imu(stamp: Stamp, reading: &Reading, imu: &mut Imu) {
    let [w, x, y, z] = reading.orientation.map(f64::from);
    imu.header.stamp = stamp;
    imu.orientation = [x, y, z, w];
    imu.angular_velocity = reading.angular_velocity.map(f64::from);
    imu.linear_acceleration = reading.linear_acceleration.map(f64::from);
}
