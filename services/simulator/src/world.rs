//! A world: walls to see and to run into, and places to start from.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::{Isometry2, Point2, Vector2};
use node::config::{Parameters, Report};
use serde::Deserialize;

use crate::geometry::{Wall, Walls};

/// A world, as its file says it.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct World {
    /// Solid blocks.
    #[serde(rename = "box")]
    pub blocks: Vec<Block>,
    /// Walls without thickness.
    #[serde(rename = "segment")]
    pub segments: Vec<Segment>,
    /// Where robots can start, by name.
    #[serde(rename = "start")]
    pub starts: BTreeMap<String, Start>,
}

/// A solid rectangle.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// [-] What messages call it.
    pub name: String,
    /// [m] Of its centre.
    pub x_m: f64,
    /// [m] Of its centre.
    pub y_m: f64,
    /// [m] Full size.
    pub size_x_m: f64,
    /// [m] Full size.
    pub size_y_m: f64,
    /// [rad] Turned about its centre, counterclockwise.
    #[serde(default)]
    pub yaw_rad: f64,
}

/// A straight wall without thickness.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// [-] What messages call it.
    pub name: String,
    /// [m] Of its first end.
    pub x1_m: f64,
    /// [m] Of its first end.
    pub y1_m: f64,
    /// [m] Of its second end.
    pub x2_m: f64,
    /// [m] Of its second end.
    pub y2_m: f64,
}

/// Where a robot can start, and the corridor that begins there.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// [m] Of the robot.
    pub x_m: f64,
    /// [m] Of the robot.
    pub y_m: f64,
    /// [rad] Of the robot, counterclockwise from x.
    pub yaw_rad: f64,
    /// [m] Side of the corridor's square cells.
    pub cell_size_m: f64,
    /// [m] The cells' centres in order, the start's own first.
    pub corridor_m: Vec<[f64; 2]>,
}

impl Parameters for World {
    fn check(&self, report: &mut Report<'_>) {
        let mut refuse = |item: String, verdict: Result<(), WorldError>| {
            if let Err(error) = verdict {
                report.refuse(format!("{item}.{}", error.key()), error.to_string(), error.help());
            }
        };
        for (index, block) in self.blocks.iter().enumerate() {
            refuse(format!("box[{index}]"), block.validate());
        }
        for (index, segment) in self.segments.iter().enumerate() {
            refuse(format!("segment[{index}]"), segment.validate());
        }
        for (name, start) in &self.starts {
            refuse(format!("start.{name}"), start.validate(name));
        }
    }
}

impl World {
    /// Refuses what no world can have.
    pub fn validate(&self) -> Result<(), WorldError> {
        if self.blocks.is_empty() && self.segments.is_empty() {
            return Err(WorldError::NoWalls);
        }
        self.blocks.iter().try_for_each(Block::validate)?;
        self.segments.iter().try_for_each(Segment::validate)?;
        self.starts.iter().try_for_each(|(name, start)| start.validate(name))
    }

    /// The start of that name.
    pub fn start(&self, name: &str) -> Result<&Start, WorldError> {
        self.starts.get(name).ok_or_else(|| WorldError::UnknownStart {
            name: name.into(),
            known: self.starts.keys().cloned().collect(),
        })
    }

    /// [m] The two ends of every wall, for one who draws the world.
    pub fn outline(&self) -> Vec<[[f64; 2]; 2]> {
        self.walls().iter().map(|wall| [wall.a, wall.b].map(|end| [end.x, end.y])).collect()
    }

    /// Every wall that a beam or the robot can meet.
    pub(crate) fn walls(&self) -> Vec<Wall> {
        let edges = self.blocks.iter().flat_map(Block::edges);
        edges.chain(self.segments.iter().map(Segment::wall)).collect()
    }

    /// Refuses a start where the robot has no room.
    pub(crate) fn check_free(
        &self,
        name: &str,
        walls: &Walls,
        radius: f64,
    ) -> Result<(), WorldError> {
        let start = self.start(name)?;
        let position = Point2::new(start.x_m, start.y_m);
        if walls.distance(position) >= radius
            && !self.blocks.iter().any(|block| block.contains(position))
        {
            return Ok(());
        }
        let by_blocks = self.blocks.iter().map(|block| {
            let distance =
                block.edges().iter().map(|edge| edge.distance(position)).fold(f64::MAX, f64::min);
            let depth =
                if block.contains(position) { radius + distance } else { radius - distance };
            (item("box", &block.name), depth)
        });
        let by_segments = self.segments.iter().map(|segment| {
            (item("segment", &segment.name), radius - segment.wall().distance(position))
        });
        let (wall, depth_m) = by_blocks
            .chain(by_segments)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .expect("validated: a world has walls");
        Err(WorldError::StartOverlaps { name: name.into(), wall, depth_m })
    }
}

impl Block {
    fn validate(&self) -> Result<(), WorldError> {
        let item = || item("box", &self.name);
        finite(item, "x_m", self.x_m)?;
        finite(item, "y_m", self.y_m)?;
        positive(item, "size_x_m", self.size_x_m)?;
        positive(item, "size_y_m", self.size_y_m)?;
        finite(item, "yaw_rad", self.yaw_rad)
    }

    fn world_from_block(&self) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(self.x_m, self.y_m), self.yaw_rad)
    }

    fn edges(&self) -> [Wall; 4] {
        let (x, y) = (0.5 * self.size_x_m, 0.5 * self.size_y_m);
        let corner = |x, y| self.world_from_block() * Point2::new(x, y);
        let corners = [corner(-x, -y), corner(x, -y), corner(x, y), corner(-x, y)];
        std::array::from_fn(|index| Wall {
            a: corners[index],
            b: corners[(index + 1) % 4],
            is_solid: true,
        })
    }

    pub(crate) fn contains(&self, position: Point2<f64>) -> bool {
        let inside = self.world_from_block().inverse_transform_point(&position);
        inside.x.abs() <= 0.5 * self.size_x_m && inside.y.abs() <= 0.5 * self.size_y_m
    }
}

impl Segment {
    fn validate(&self) -> Result<(), WorldError> {
        let item = || item("segment", &self.name);
        finite(item, "x1_m", self.x1_m)?;
        finite(item, "y1_m", self.y1_m)?;
        finite(item, "x2_m", self.x2_m)?;
        finite(item, "y2_m", self.y2_m)?;
        let Wall { a, b, .. } = self.wall();
        if a == b { Err(WorldError::NoLength { item: item() }) } else { Ok(()) }
    }

    fn wall(&self) -> Wall {
        Wall {
            a: Point2::new(self.x1_m, self.y1_m),
            b: Point2::new(self.x2_m, self.y2_m),
            is_solid: false,
        }
    }
}

impl Start {
    /// The rest of the corridor, from this cell on, as a start of its own that looks ahead. `None` where
    /// there is no cell after it.
    pub fn from_cell(&self, cell: usize) -> Option<Self> {
        let corridor_m = self.corridor_m.get(cell..)?.to_vec();
        let &[[x_m, y_m], [next_x, next_y], ..] = corridor_m.as_slice() else { return None };
        let yaw_rad = libm::atan2(next_y - y_m, next_x - x_m);
        Some(Self { x_m, y_m, yaw_rad, cell_size_m: self.cell_size_m, corridor_m })
    }

    fn validate(&self, name: &str) -> Result<(), WorldError> {
        let item = || item("start", name);
        finite(item, "x_m", self.x_m)?;
        finite(item, "y_m", self.y_m)?;
        finite(item, "yaw_rad", self.yaw_rad)?;
        positive(item, "cell_size_m", self.cell_size_m)?;
        for &value in self.corridor_m.iter().flatten() {
            finite(item, "corridor_m", value)?;
        }
        self.validate_corridor(name)
    }

    /// A corridor is a chain of neighbours that begins where the robot does.
    fn validate_corridor(&self, name: &str) -> Result<(), WorldError> {
        let cells = self.corridor_m.len();
        if cells < 2 {
            return Err(WorldError::ShortCorridor { name: name.into(), cells });
        }
        let centres = self.corridor_m.iter().map(|&centre| Point2::from(centre));
        for (index, (cell, next)) in centres.clone().zip(centres.clone().skip(1)).enumerate() {
            let is_neighbour =
                ((next - cell).norm() - self.cell_size_m).abs() < 0.01 * self.cell_size_m;
            if !is_neighbour {
                return Err(WorldError::BrokenCorridor { name: name.into(), cell: index + 1 });
            }
        }
        let offset = Point2::new(self.x_m, self.y_m) - Point2::from(self.corridor_m[0]);
        if offset.amax() > 0.5 * self.cell_size_m {
            return Err(WorldError::StartOutside { name: name.into() });
        }
        Ok(())
    }

    pub(crate) fn world_from_base(&self) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(self.x_m, self.y_m), self.yaw_rad)
    }
}

fn item(kind: &str, name: &str) -> String {
    format!("{kind} `{name}`")
}

fn finite(item: impl Fn() -> String, key: &'static str, value: f64) -> Result<(), WorldError> {
    if value.is_finite() { Ok(()) } else { Err(WorldError::NotFinite { item: item(), key, value }) }
}

fn positive(item: impl Fn() -> String, key: &'static str, value: f64) -> Result<(), WorldError> {
    finite(&item, key, value)?;
    if value > 0.0 { Ok(()) } else { Err(WorldError::NotPositive { item: item(), key, value }) }
}

/// What is wrong with a world.
#[derive(Debug, Clone, PartialEq)]
pub enum WorldError {
    /// There is no box and no segment.
    NoWalls,
    /// The value is NaN or infinite.
    NotFinite {
        /// [-] Which box, segment or start.
        item: String,
        /// [-] The key.
        key: &'static str,
        /// [-] Its value.
        value: f64,
    },
    /// The value must be above zero.
    NotPositive {
        /// [-] Which box, segment or start.
        item: String,
        /// [-] The key.
        key: &'static str,
        /// [-] Its value.
        value: f64,
    },
    /// The segment's two ends are the same point.
    NoLength {
        /// [-] Which segment.
        item: String,
    },
    /// A corridor has at least two cells.
    ShortCorridor {
        /// [-] The start whose corridor it is.
        name: String,
        /// [-] Cells that it has.
        cells: usize,
    },
    /// A cell of the corridor is not beside the one before it.
    BrokenCorridor {
        /// [-] The start whose corridor it is.
        name: String,
        /// [-] The cell, counted from 0.
        cell: usize,
    },
    /// The robot would start outside of its corridor's first cell.
    StartOutside {
        /// [-] The start.
        name: String,
    },
    /// No start has this name.
    UnknownStart {
        /// [-] The name asked for.
        name: String,
        /// [-] The names there are.
        known: Vec<String>,
    },
    /// The robot would start in a wall.
    StartOverlaps {
        /// [-] The start.
        name: String,
        /// [-] The wall that it is deepest in.
        wall: String,
        /// [m] How deep.
        depth_m: f64,
    },
}

impl WorldError {
    /// [-] The key of the value that is wrong.
    pub const fn key(&self) -> &'static str {
        match self {
            Self::NoWalls => "box",
            Self::NotFinite { key, .. } | Self::NotPositive { key, .. } => key,
            Self::NoLength { .. } => "x2_m",
            Self::ShortCorridor { .. } | Self::BrokenCorridor { .. } => "corridor_m",
            Self::StartOutside { .. } | Self::StartOverlaps { .. } => "x_m",
            Self::UnknownStart { .. } => "start",
        }
    }

    /// What mends it.
    pub const fn help(&self) -> &'static str {
        match self {
            Self::NoWalls => "add a `[[box]]` or a `[[segment]]`",
            Self::NotFinite { .. } => "write a finite number",
            Self::NotPositive { .. } => "write a number above zero",
            Self::NoLength { .. } => "move one of the ends",
            Self::ShortCorridor { .. } | Self::BrokenCorridor { .. } => {
                "list the centres of neighbouring cells, from the start to the dead end"
            }
            Self::StartOutside { .. } | Self::StartOverlaps { .. } => {
                "move the start to free space in the corridor's first cell"
            }
            Self::UnknownStart { .. } => "choose another with --start, or add it to the world",
        }
    }
}

impl fmt::Display for WorldError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoWalls => write!(formatter, "the world has no `box` and no `segment`"),
            Self::NotFinite { item, key, value } => {
                write!(formatter, "{item}: `{key}` is {value}, which is not a finite number")
            }
            Self::NotPositive { item, key, value } => {
                write!(formatter, "{item}: `{key}` is {value}, but must be above zero")
            }
            Self::NoLength { item } => write!(formatter, "{item}: its two ends are the same point"),
            Self::ShortCorridor { name, cells } => write!(
                formatter,
                "start `{name}`: `corridor_m` has {cells} cells, but must have at least 2"
            ),
            Self::BrokenCorridor { name, cell } => write!(
                formatter,
                "start `{name}`: cell {cell} of `corridor_m` is not `cell_size_m` from the cell \
                 before it"
            ),
            Self::StartOutside { name } => write!(
                formatter,
                "start `{name}`: the robot is outside of the first cell of `corridor_m`"
            ),
            Self::UnknownStart { name, known } => write!(
                formatter,
                "the world has no start `{name}`; it has {}",
                if known.is_empty() { "none".into() } else { format!("`{}`", known.join("`, `")) }
            ),
            Self::StartOverlaps { name, wall, depth_m } => write!(
                formatter,
                "start `{name}`: the robot would be {depth_m:.3} m deep in {wall}"
            ),
        }
    }
}

impl std::error::Error for WorldError {}

#[cfg(test)]
mod tests {
    use super::*;

    const LAB02: &str = include_str!("../../../config/worlds/lab02.toml");
    const LOOP: &str = include_str!("../../../config/worlds/loop.toml");

    /// One wall and one start, both right.
    const SMALL: &str = "
        [[box]]
        name = 'block'
        x_m = 1.0
        y_m = 0.0
        size_x_m = 0.4
        size_y_m = 0.4

        [[segment]]
        name = 'line'
        x1_m = -1.0
        y1_m = -1.0
        x2_m = -1.0
        y2_m = 1.0

        [start.here]
        x_m = 0.0
        y_m = 0.0
        yaw_rad = 0.0
        cell_size_m = 0.4
        corridor_m = [[0.0, 0.0], [0.4, 0.0]]
    ";

    /// What keeps a robot of the lab from starting in this world.
    fn problem(text: &str, start: &str) -> Option<String> {
        let world: World = toml::from_str(text).unwrap();
        let check = || {
            world.validate()?;
            world.start(start)?;
            world.check_free(start, &Walls::new(world.walls()), 0.105)
        };
        check().err().map(|error| error.to_string())
    }

    #[test]
    fn every_world_that_we_ship_is_right() {
        for (text, start) in [(LAB02, "outer"), (LAB02, "inner"), (LOOP, "ring"), (SMALL, "here")] {
            assert_eq!(problem(text, start), None, "{start}");
        }
        let world: World = toml::from_str(LAB02).unwrap();
        assert_eq!(world.blocks.len(), 14);
        assert!(world.starts.values().all(|start| start.corridor_m.len() == 16));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_item_and_key() {
        let table = [
            (("x_m = 1.0", "x_m = nan"), "box `block`: `x_m` is NaN, which is not a finite number"),
            (
                ("y2_m = 1.0", "y2_m = inf"),
                "segment `line`: `y2_m` is inf, which is not a finite number",
            ),
            (
                ("yaw_rad = 0.0", "yaw_rad = -inf"),
                "start `here`: `yaw_rad` is -inf, which is not a finite number",
            ),
            (
                ("[0.4, 0.0]", "[nan, 0.0]"),
                "start `here`: `corridor_m` is NaN, which is not a finite number",
            ),
            (
                ("size_x_m = 0.4", "size_x_m = 0"),
                "box `block`: `size_x_m` is 0, but must be above zero",
            ),
            (
                ("size_y_m = 0.4", "size_y_m = -1"),
                "box `block`: `size_y_m` is -1, but must be above zero",
            ),
            (
                ("cell_size_m = 0.4", "cell_size_m = 0"),
                "start `here`: `cell_size_m` is 0, but must be above zero",
            ),
            (("y2_m = 1.0", "y2_m = -1.0"), "segment `line`: its two ends are the same point"),
            (
                (", [0.4, 0.0]", ""),
                "start `here`: `corridor_m` has 1 cells, but must have at least 2",
            ),
            (
                ("[0.4, 0.0]", "[0.8, 0.0]"),
                "start `here`: cell 1 of `corridor_m` is not `cell_size_m` from the cell before it",
            ),
            (
                ("[[0.0, 0.0], [0.4, 0.0]]", "[[0.4, 0.0], [0.0, 0.0]]"),
                "start `here`: the robot is outside of the first cell of `corridor_m`",
            ),
            (("start.here", "start.there"), "the world has no start `here`; it has `there`"),
            (
                ("x_m = 1.0", "x_m = 0.25"),
                "start `here`: the robot would be 0.055 m deep in box `block`",
            ),
            (
                ("x_m = 1.0", "x_m = 0.0"),
                "start `here`: the robot would be 0.305 m deep in box `block`",
            ),
            (
                ("x1_m = -1.0", "x1_m = 1.0"),
                "start `here`: the robot would be 0.105 m deep in segment `line`",
            ),
        ];
        for ((right, wrong), message) in table {
            assert!(SMALL.contains(right), "{right}");
            let text = SMALL.replacen(right, wrong, 1);
            assert_eq!(problem(&text, "here").as_deref(), Some(message), "{wrong}");
        }
        assert_eq!(problem("", "here").as_deref(), Some("the world has no `box` and no `segment`"));
    }

    #[test]
    fn a_robot_can_start_at_any_cell_that_has_one_after_it() {
        let corridor_m = vec![[0.0, 0.0], [0.4, 0.0], [0.4, -0.4]];
        let start = Start { x_m: 0.1, y_m: 0.0, yaw_rad: 1.0, cell_size_m: 0.4, corridor_m };
        let second = Start {
            x_m: 0.4,
            y_m: 0.0,
            yaw_rad: -std::f64::consts::FRAC_PI_2,
            cell_size_m: 0.4,
            corridor_m: vec![[0.4, 0.0], [0.4, -0.4]],
        };
        assert_eq!(second.validate("second"), Ok(()));
        let table = [Some(second), None, None];
        assert_eq!([1, 2, 3].map(|cell| start.from_cell(cell)), table);
    }

    #[test]
    fn a_key_that_nobody_knows_or_that_is_missing_is_refused() {
        for (right, wrong) in
            [("size_x_m", "size_x"), ("x1_m", "x_m"), ("yaw_rad", "yaw"), ("[[box]]", "[[bocks]]")]
        {
            let text = SMALL.replacen(right, wrong, 1);
            let error = toml::from_str::<World>(&text).unwrap_err().to_string();
            assert!(error.contains(&wrong.replace(['[', ']'], "")), "{error}");
        }
    }

    #[test]
    fn a_turned_box_is_where_its_corners_are() {
        let text = SMALL.replace("x_m = 1.0\n", "x_m = 1.0\nyaw_rad = 0.7853981633974483\n");
        let world: World = toml::from_str(&text).unwrap();
        let walls = Walls::new(world.walls());
        // Half the diagonal of 0.4 m is 0.2828 m.
        let distance = walls.distance(Point2::origin());
        assert!((distance - (1.0 - 0.08_f64.sqrt())).abs() < 1e-12, "{distance}");
        assert!(world.blocks[0].contains(Point2::new(1.25, 0.0)));
        assert!(!world.blocks[0].contains(Point2::new(1.18, 0.18)));
    }
}
