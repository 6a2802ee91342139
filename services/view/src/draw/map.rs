//! The map: walls, trail, what the LiDAR sees, the robot.

use ratatui::Frame;
use ratatui::layout::Rect;

use super::Look;
use crate::raster::{Ink, Raster};
use crate::state::{Place, State};

/// [m] Of the robot: a Burger's.
const RADIUS: f64 = 0.105;

/// [m] From the middle of the robot to where it points.
const POINTER: f64 = 0.2;

/// [m] Between two points of a trail that were not driven through.
const LEAP: f64 = 0.3;

/// [m] Where there are no walls: at least so much around the robot.
const AROUND: f64 = 1.0;

pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, state: &State, look: Look) {
    let place = &state.place;
    let title = match (place.pose(), place.is_known()) {
        (None, _) => "map".to_owned(),
        (Some(pose), true) => {
            let degrees = pose.yaw.to_degrees().rem_euclid(360.0);
            format!("map  x {:.2} y {:.2} m {degrees:.0} deg", pose.x, pose.y)
        }
        (Some(_), false) => "map  odometry began elsewhere".to_owned(),
    };
    let block = look.block(&title);
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let raster = picture(place, inner);
    let buffer = frame.buffer_mut();
    for (column, row, character, ink) in raster.cells(look.ascii) {
        let cell = &mut buffer[(inner.x + column, inner.y + row)];
        cell.set_char(character).set_style(look.ink(ink));
    }
    if look.ascii
        && let Some(pose) = place.pose()
        && let Some((column, row)) = raster.cell([pose.x, pose.y])
    {
        buffer[(inner.x + column, inner.y + row)].set_char(arrow(pose.yaw));
    }
}

fn picture(place: &Place, inner: Rect) -> Raster {
    let (low, high) = bounds(place);
    let mut raster = Raster::new(inner.width, inner.height, low, high);
    for [from, to] in place.map.iter().flat_map(|map| &map.walls) {
        raster.line(*from, *to, Ink::Wall);
    }
    for (from, to) in place.trail.iter().zip(place.trail.iter().skip(1)) {
        // One who was not looked at for a while, or was put elsewhere, went nobody knows which way.
        if libm::hypot(to[0] - from[0], to[1] - from[1]) < LEAP {
            raster.line(*from, *to, Ink::Trail);
        }
    }
    for point in &place.returns {
        raster.dot(*point, Ink::Return);
    }
    if let Some(pose) = place.pose() {
        raster.circle([pose.x, pose.y], RADIUS, Ink::Robot);
        raster.line([pose.x, pose.y], pose.place([POINTER, 0.0]), Ink::Robot);
    }
    raster
}

/// [m] The corners of everything that stays where it is.
fn bounds(place: &Place) -> ([f64; 2], [f64; 2]) {
    let walls = place.map.iter().flat_map(|map| map.walls.iter().flatten().copied());
    let mut points: Vec<_> = walls.collect();
    if points.is_empty() {
        points.extend(place.trail.iter().copied());
        points.extend(place.returns.iter().copied());
        let [x, y] = place.pose().map_or([0.0, 0.0], |pose| [pose.x, pose.y]);
        points.extend([[x - AROUND, y - AROUND], [x + AROUND, y + AROUND]]);
    }
    let fold = |start: f64, pick: fn(f64, f64) -> f64| {
        points.iter().fold([start; 2], |corner, point| {
            [pick(corner[0], point[0]), pick(corner[1], point[1])]
        })
    };
    (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max))
}

/// A heading, to a quarter turn.
fn arrow(yaw: f64) -> char {
    let quarters = (yaw / std::f64::consts::FRAC_PI_2).round().rem_euclid(4.0);
    match quarters {
        quarters if quarters < 0.5 => '>',
        quarters if quarters < 1.5 => '^',
        quarters if quarters < 2.5 => '<',
        _ => 'v',
    }
}
