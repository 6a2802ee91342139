//! Messages by the names of their fields: what people and scripts are shown of them, and may fill in.

use crate::{
    BatteryState, BoardRequest, ChangeState, Header, Imu, JointState, LaserScan, Message,
    MotionRequest, MotionState, NodeStatus, Odometry, Outcome, ParameterChange, Permission,
    PortStatus, Pose, SensorPair, SensorState, SetParameter, Stamp, State, StopCause, Text,
    Transition, TransitionEvent, Value, VelocityCommand,
};

/// A message of the topic table, whose fields have names.
pub trait Described: Message {
    /// [-] What its type is called.
    const NAME: &'static str;

    /// What it holds behind its header.
    fn fields(&self) -> Vec<Field>;

    /// Fills in the field called `name` with what `text` says; several values with commas between.
    fn set(&mut self, name: &str, text: &str) -> Result<(), SetError>;
}

/// One field of a message, as it stands in one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Its unit, as in the comment of the field; `-` where it has none.
    pub unit: &'static str,
    /// What it holds.
    pub value: FieldValue,
}

/// What a field holds.
#[derive(Debug, Clone, PartialEq)]
pub enum FieldValue {
    /// A number that counts something, or names it.
    Count(u64),
    /// A number that may be negative.
    Integer(i64),
    /// A measurement; also NaN and infinities.
    Real(f64),
    /// What the number in the message stands for.
    Word(&'static str),
    /// Text, whatever another process wrote into it.
    Text(String),
    /// Several of one kind.
    List(Vec<Self>),
    /// Fields of its own.
    Group(Vec<Field>),
}

/// Why a field cannot be filled in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetError {
    /// The message has no field of this name.
    NoField,
    /// The text is nothing that the field can hold.
    NoValue,
}

/// What a field of a message can be made of.
trait Content {
    /// What it holds.
    fn value(&self) -> FieldValue;

    /// Takes what `text` says; `None` where that says nothing of the kind.
    fn read(&mut self, _text: &str) -> Option<()> {
        None
    }
}

macro_rules! numbers {
    ($($kind:ty as $variant:ident),* $(,)?) => {$(
        impl Content for $kind {
            fn value(&self) -> FieldValue {
                FieldValue::$variant((*self).into())
            }

            fn read(&mut self, text: &str) -> Option<()> {
                *self = text.parse().ok()?;
                Some(())
            }
        }
    )*};
}

numbers!(u8 as Count, u32 as Count, u64 as Count, i32 as Integer, f64 as Real);

impl Content for f32 {
    fn value(&self) -> FieldValue {
        // By way of its shortest text: 0.1 is 0.1 for people, not 0.10000000149.
        FieldValue::Real(self.to_string().parse().unwrap_or(f64::NAN))
    }

    fn read(&mut self, text: &str) -> Option<()> {
        *self = text.parse().ok()?;
        Some(())
    }
}

impl Content for Stamp {
    fn value(&self) -> FieldValue {
        FieldValue::Count(self.nanoseconds)
    }

    fn read(&mut self, text: &str) -> Option<()> {
        self.nanoseconds.read(text)
    }
}

impl Content for Text {
    fn value(&self) -> FieldValue {
        FieldValue::Text(self.to_string())
    }
}

impl<T: Content> Content for [T] {
    fn value(&self) -> FieldValue {
        FieldValue::List(self.iter().map(Content::value).collect())
    }

    /// As many as there are, with commas in between.
    fn read(&mut self, text: &str) -> Option<()> {
        if text.split(',').count() != self.len() {
            return None;
        }
        self.iter_mut().zip(text.split(',')).try_for_each(|(item, text)| item.read(text.trim()))
    }
}

impl<T: Content, const N: usize> Content for [T; N] {
    fn value(&self) -> FieldValue {
        self.as_slice().value()
    }

    fn read(&mut self, text: &str) -> Option<()> {
        self.as_mut_slice().read(text)
    }
}

impl Content for PortStatus {
    fn value(&self) -> FieldValue {
        let count = |name, value| Field { name, unit: "-", value: FieldValue::Count(value) };
        FieldValue::Group(vec![
            Field { name: "topic", unit: "-", value: self.topic.value() },
            count("publishes", self.publishes.into()),
            count("on_event", self.on_event.into()),
            count("samples", self.samples),
            count("lost", self.lost),
            count("unread", self.unread),
            count("stale", self.stale),
            count("digest", self.digest),
        ])
    }
}

impl Content for Value {
    fn value(&self) -> FieldValue {
        FieldValue::Group(vec![
            Field { name: "key", unit: "-", value: self.key.value() },
            Field { name: "value", unit: "as the key says", value: self.value.value() },
        ])
    }
}

/// The word for a number that another process wrote, or the number itself.
fn word<T: TryFrom<u8>>(number: u8, label: fn(T) -> &'static str) -> FieldValue {
    T::try_from(number)
        .map_or(FieldValue::Count(number.into()), |named| FieldValue::Word(label(named)))
}

/// Every message with the units of its fields, in the order of the struct. `by` is for a field that
/// is shown otherwise than as it lies in memory.
macro_rules! messages {
    ($($message:ident { $($field:ident $(by $shown:expr)? => $unit:literal),* $(,)? })*) => {$(
        impl Message for $message {
            fn header(&self) -> &Header {
                &self.header
            }

            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }

        impl Described for $message {
            const NAME: &'static str = stringify!($message);

            fn fields(&self) -> Vec<Field> {
                vec![$(Field {
                    name: stringify!($field),
                    unit: $unit,
                    value: messages!(@value self, $field $(, $shown)?),
                }),*]
            }

            fn set(&mut self, name: &str, text: &str) -> Result<(), SetError> {
                let read = match name {
                    $(stringify!($field) => self.$field.read(text),)*
                    _ => return Err(SetError::NoField),
                };
                read.ok_or(SetError::NoValue)
            }
        }
    )*};
    (@value $message:ident, $field:ident) => { $message.$field.value() };
    (@value $message:ident, $field:ident, $shown:expr) => { $shown($message) };
}

messages! {
    LaserScan {
        angle_min => "rad",
        angle_max => "rad",
        angle_increment => "rad",
        time_increment => "s",
        scan_time => "s",
        range_min => "m",
        range_max => "m",
        length => "-",
        range by |scan: &Self| scan.ranges().value() => "m",
        intensity by |scan: &Self| scan.intensities().value() => "-",
    }
    JointState { position => "rad", increment => "rad", velocity => "rad/s" }
    Odometry { x => "m", y => "m", yaw => "rad", linear => "m/s", angular => "rad/s" }
    VelocityCommand { linear => "m/s", angular => "rad/s" }
    Pose { x => "m", y => "m", yaw => "rad", localized => "-" }
    SensorPair {
        scan_stamp => "ns",
        odometry_stamp => "ns",
        scan_sequence => "-",
        odometry_sequence => "-",
        scan_epoch => "-",
        odometry_epoch => "-",
        spread_ns => "ns",
        formed => "ns",
    }
    Imu { orientation => "-", angular_velocity => "rad/s", linear_acceleration => "m/s^2" }
    BatteryState { voltage => "V", percentage => "-" }
    SensorState {
        encoder_ticks => "ticks",
        motor_current => "-",
        bumper => "-",
        button => "-",
        torque => "-",
        motors => "-",
        firmware => "-",
    }
    BoardRequest { asks_sound => "-", sound => "-", asks_torque => "-", torque => "-" }
    MotionState {
        permission by |state: &Self| word(state.permission, Permission::label) => "-",
        cause by |state: &Self| word(state.cause, StopCause::label) => "-",
        needs_person => "-",
        emergency_stop => "-",
        command_epoch => "-",
        command_sequence => "-",
        command_received => "ns",
        accepted => "-",
        rejected => "-",
        trips => "-",
    }
    MotionRequest { arm => "-" }
    ChangeState {
        transition by |request: &Self| word(request.transition, Transition::label) => "-",
    }
    TransitionEvent {
        start_state by |event: &Self| word(event.start_state, State::label) => "-",
        goal_state by |event: &Self| word(event.goal_state, State::label) => "-",
        reason => "-",
    }
    SetParameter { key => "-", value => "as the key says" }
    ParameterChange {
        request => "-",
        accepted => "-",
        key => "-",
        former => "as the key says",
        value => "as the key says",
        reason => "-",
    }
    NodeStatus {
        state by |status: &Self| word(status.state, State::label) => "-",
        outcome by |status: &Self| word(status.outcome, Outcome::label) => "-",
        process => "-",
        port_count => "-",
        value_count => "-",
        text => "-",
        port by |status: &Self| status.ports().value() => "-",
        value by |status: &Self| status.values().value() => "-",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_says_what_it_holds_and_in_which_unit() {
        let command = VelocityCommand { linear: 0.1, ..VelocityCommand::default() };

        let fields = command.fields();
        assert_eq!(fields.len(), 2);
        let linear = Field { name: "linear", unit: "m/s", value: FieldValue::Real(0.1) };
        assert_eq!(fields[0], linear);
    }

    #[test]
    fn a_scan_shows_the_beams_that_it_has_as_short_as_they_are() {
        let mut scan = LaserScan { length: 2, ..LaserScan::default() };
        scan.ranges_mut().copy_from_slice(&[0.1, f32::INFINITY]);
        let ranges = scan.fields().into_iter().find(|field| field.name == "range").unwrap();

        let shown = [0.1, f64::INFINITY].map(FieldValue::Real);
        assert_eq!(ranges.value, FieldValue::List(shown.to_vec()));
    }

    #[test]
    fn numbers_that_stand_for_words_are_shown_as_such_and_strangers_as_they_are() {
        let mut state = MotionState { permission: 2, cause: 3, ..MotionState::default() };
        assert_eq!(state.fields()[0].value, FieldValue::Word("held"));
        assert_eq!(state.fields()[1].value, FieldValue::Word("emergency stop"));

        state.permission = 77;
        assert_eq!(state.fields()[0].value, FieldValue::Count(77));
    }

    #[test]
    fn fields_are_filled_in_by_name_and_what_does_not_fit_is_refused() {
        let mut joints = JointState::default();
        assert_eq!(joints.set("velocity", "1.5, -2"), Ok(()));
        let set = FieldValue::List([1.5, -2.0].map(FieldValue::Real).to_vec());
        assert_eq!(joints.fields()[2].value, set);
        for (name, text, error) in [
            ("speed", "1", SetError::NoField),
            ("header", "1", SetError::NoField),
            ("velocity", "1", SetError::NoValue),
            ("velocity", "1,2,3", SetError::NoValue),
            ("velocity", "1,fast", SetError::NoValue),
        ] {
            assert_eq!(joints.set(name, text), Err(error), "{name}={text}");
        }
        assert_eq!(BoardRequest::default().set("sound", "256"), Err(SetError::NoValue));
    }
}
