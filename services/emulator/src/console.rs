//! What a person, or a test, says to the emulator: one line each.

use crate::line::Fault;

/// Which of the two lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    Board,
    Lidar,
}

/// What shall happen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Order {
    Unplug(Place),
    Plug(Place),
    Fault(Place, Fault),
    /// Whether the board gathers nothing anew.
    Hang(bool),
    /// Whether the motors have power.
    Power(bool),
    /// [V]
    Battery(f64),
    /// Whether button 1 is pressed.
    Button(bool),
}

/// All there is to say.
pub(crate) const HELP: &str = "unplug, plug, silent, garbage, half, damaged, well: each board or lidar; \
     hang, power, button: each on or off; battery VOLTS";

impl Order {
    /// From a line; `None` where it says nothing.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let (word, rest) = line.trim().split_once(' ')?;
        let place = || match rest {
            "board" => Some(Place::Board),
            "lidar" => Some(Place::Lidar),
            _ => None,
        };
        let is_on = || match rest {
            "on" => Some(true),
            "off" => Some(false),
            _ => None,
        };
        Some(match word {
            "unplug" => Self::Unplug(place()?),
            "plug" => Self::Plug(place()?),
            "silent" => Self::Fault(place()?, Fault::Silent),
            "garbage" => Self::Fault(place()?, Fault::Garbage),
            "half" => Self::Fault(place()?, Fault::Half),
            "damaged" => Self::Fault(place()?, Fault::Damaged),
            "well" => Self::Fault(place()?, Fault::None),
            "hang" => Self::Hang(is_on()?),
            "power" => Self::Power(is_on()?),
            "button" => Self::Button(is_on()?),
            "battery" => {
                Self::Battery(rest.parse().ok().filter(|volts| (0.0..=20.0).contains(volts))?)
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_shall_happen_or_nothing() {
        let table = [
            ("unplug board", Some(Order::Unplug(Place::Board))),
            ("half lidar\n", Some(Order::Fault(Place::Lidar, Fault::Half))),
            ("hang on", Some(Order::Hang(true))),
            ("battery 10.9", Some(Order::Battery(10.9))),
            ("battery nan", None),
            ("unplug robot", None),
            ("power perhaps", None),
            ("", None),
        ];
        for (line, expected) in table {
            assert_eq!(Order::parse(line), expected, "{line}");
        }
    }
}
