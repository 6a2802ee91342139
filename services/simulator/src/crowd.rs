//! Several robots in one world: each sees the others, and they stop each other.

use std::fmt;

use crate::Simulator;
use crate::discs::Disc;

/// Robots that were made for the same world.
pub struct Crowd {
    robots: Vec<Simulator>,
    /// Where they are.
    discs: Vec<Disc>,
}

impl Crowd {
    /// Refuses robots of which two are in one place.
    pub fn new(robots: Vec<Simulator>) -> Result<Self, Overlap> {
        let discs: Vec<_> = robots.iter().map(Simulator::disc).collect();
        for (second, disc) in discs.iter().enumerate() {
            let is_in = |other: &Disc| other.distance(disc.centre) < disc.radius;
            if let Some(first) = discs[..second].iter().position(is_in) {
                return Err(Overlap { robots: [first, second] });
            }
        }
        let mut crowd = Self { robots, discs };
        crowd.meet_all();
        Ok(crowd)
    }

    /// Drives each for one step by its own command, `linear` [m/s] and `angular` [rad/s]; see
    /// [`Simulator::step`].
    ///
    /// They move one after another, each among the others where these are by then. Who runs into
    /// another stops at contact and has a collision; who is run into has none, and is not moved.
    pub fn step(&mut self, commands: &[(f64, f64)]) {
        for (index, &(linear, angular)) in commands.iter().enumerate() {
            self.meet(index);
            self.robots[index].step(linear, angular);
            self.discs[index] = self.robots[index].disc();
        }
        self.meet_all();
    }

    /// The robots, in the order in which they were given: to be measured with.
    pub fn robots(&mut self) -> &mut [Simulator] {
        &mut self.robots
    }

    fn meet_all(&mut self) {
        (0..self.robots.len()).for_each(|index| self.meet(index));
    }

    fn meet(&mut self, index: usize) {
        let (before, rest) = self.discs.split_at(index);
        self.robots[index].meet(before.iter().chain(&rest[1..]).copied());
    }
}

/// Two robots would be in one place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Overlap {
    /// [-] Which, counted from 0.
    pub robots: [usize; 2],
}

impl fmt::Display for Overlap {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.robots;
        write!(formatter, "robots {first} and {second} would be in one place")
    }
}

impl std::error::Error for Overlap {}
