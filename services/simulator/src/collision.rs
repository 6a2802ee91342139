//! Where a round robot on its arc first touches a wall, or another robot, in closed form: it cannot
//! tunnel.

use nalgebra::{Isometry2, Point2, Vector2};

use crate::arc::Arc;
use crate::discs::Disc;
use crate::geometry::{Wall, Walls};

/// [m] Deeper than this into a wall is a contact, less is rounding.
const TOUCH: f64 = 1e-9;

/// [m] So far from the wall a contact is over; less is the same contact still.
const RELEASE: f64 = 1e-3;

/// [m] What the distance of a point some metres from the origin may be off by.
const ROUNDING: f64 = 1e-14;

/// [rad] A path that turns less is straight to within rounding.
const STRAIGHT: f64 = 1e-12;

/// [-] Two crossings with each side of a wall and with each of its ends, and the path's own two ends.
const WALL_STOPS: usize = 10;

/// [-] Two crossings with the edge of a disc, and the path's own two ends.
const DISC_STOPS: usize = 4;

/// The robot's edge against walls and other robots, over a run. Clearance is that to the walls.
pub(crate) struct Contact {
    radius: f64,
    position: Point2<f64>,
    clearance: f64,
    clearance_min: f64,
    collisions: u64,
    touching: bool,
}

impl Contact {
    pub(crate) fn new(radius: f64, walls: &Walls, world_from_base: &Isometry2<f64>) -> Self {
        let position = world_from_base.translation.vector.into();
        let clearance = walls.distance(position) - radius;
        Self {
            radius,
            position,
            clearance,
            clearance_min: clearance,
            collisions: 0,
            touching: false,
        }
    }

    /// [-] The fraction of the arc that the robot gets; less than 1 is a contact.
    pub(crate) fn limit(&mut self, arc: &Arc, walls: &Walls, others: &[Disc]) -> f64 {
        // A detour is longer than the straight way, so nothing farther than the arc is long matters.
        let reach = arc.distance.abs() + TOUCH;
        let is_near = |clearance: f64| clearance <= reach;
        let are_others_near = others.iter().any(|other| is_near(self.gap(other)));
        if !is_near(self.clearance) && !are_others_near {
            return 1.0;
        }
        let path = Path::new(arc);
        let near = walls.near(path.start, self.radius + path.length + TOUCH);
        let contact = near
            .filter_map(|wall| path.first_contact(wall, self.radius))
            .chain(others.iter().filter_map(|other| path.first_contact_with(other, self.radius)))
            .min_by(f64::total_cmp);
        if contact.is_some() && !self.touching {
            self.collisions += 1;
            self.touching = true;
        }
        contact.unwrap_or(1.0)
    }

    /// Takes note of where the robot has come to.
    pub(crate) fn arrive(
        &mut self,
        walls: &Walls,
        others: &[Disc],
        world_from_base: &Isometry2<f64>,
    ) {
        let position = Point2::from(world_from_base.translation.vector);
        // No wall comes nearer by more than the robot has moved.
        let bound = self.clearance + self.radius + (position - self.position).norm() + TOUCH;
        self.clearance = walls.distance_within(position, bound) - self.radius;
        self.position = position;
        self.clearance_min = self.clearance_min.min(self.clearance);
        if self.clearance > RELEASE && others.iter().all(|other| self.gap(other) > RELEASE) {
            self.touching = false;
        }
    }

    /// [m] Between the edges.
    fn gap(&self, other: &Disc) -> f64 {
        other.distance(self.position) - self.radius
    }

    pub(crate) fn radius(&self) -> f64 {
        self.radius
    }

    pub(crate) fn clearance(&self) -> f64 {
        self.clearance
    }

    pub(crate) fn clearance_min(&self) -> f64 {
        self.clearance_min
    }

    pub(crate) fn collisions(&self) -> u64 {
        self.collisions
    }
}

/// An arc seen from the way it goes: the robot starts `ahead` and bends to `aside`.
///
/// Its points are `start + (ahead * u + aside * bend * u² / 2) / (1 + bend² * u² / 4)`, the rational
/// form of the circle. In `u`, which for small paths is their length, every contact is a quadratic
/// equation, and a straight path is the case `bend` = 0 and no other formula.
struct Path<'a> {
    arc: &'a Arc,
    start: Point2<f64>,
    ahead: Vector2<f64>,
    aside: Vector2<f64>,
    /// [m]
    length: f64,
    /// [1/m] One over the radius, never negative.
    bend: f64,
}

impl<'a> Path<'a> {
    fn new(arc: &'a Arc) -> Self {
        let length = arc.distance.abs();
        let bends = arc.turn.abs() > STRAIGHT;
        let bend = if bends { arc.turn.abs() / length } else { 0.0 };

        let forward = arc.world_from_base.rotation * Vector2::x();
        let ahead = forward * arc.distance.signum();
        let left_of_ahead = Vector2::new(-ahead.y, ahead.x);
        let aside = left_of_ahead * arc.turn.signum();
        let start = arc.world_from_base.translation.vector.into();
        Self { arc, start, ahead, aside, length, bend }
    }

    /// [-] The fraction of the path after which a disc of `radius` touches the wall, if it does.
    fn first_contact(&self, wall: &Wall, radius: f64) -> Option<f64> {
        let stops = || self.wall_stops(wall, radius);
        self.enter(radius, |point| wall.distance(point), stops)
    }

    /// [-] The same with another disc that stands still.
    fn first_contact_with(&self, other: &Disc, radius: f64) -> Option<f64> {
        let meets = || self.meet_circle(other.centre, radius + other.radius);
        let stops = || self.in_order::<DISC_STOPS>(&[meets()]);
        self.enter(radius, |point| other.distance(point), stops)
    }

    /// [-] Where the path first comes nearer than `radius` to what is so far from a point; it may do
    /// so at one of the `stops` only.
    fn enter<const N: usize>(
        &self,
        radius: f64,
        distance_from: impl Fn(Point2<f64>) -> f64,
        stops: impl FnOnce() -> [f64; N],
    ) -> Option<f64> {
        let distance = distance_from(self.start);
        if distance > radius + self.length + TOUCH {
            return None;
        }

        // Between two stops the robot is either clear of the wall or in it, so that one look at the
        // middle decides, and a graze or a start at contact needs no care. A robot that rounding put
        // into the wall may leave it but not go deeper.
        let deepest = (radius - TOUCH).min(distance - ROUNDING);
        stops().windows(2).find_map(|stop| {
            let middle = self.arc.at(0.5 * (stop[0] + stop[1])).translation.vector;
            (distance_from(middle.into()) < deepest).then_some(stop[0])
        })
    }

    /// [-] The fractions of the path where the disc may begin or cease to touch the wall.
    fn wall_stops(&self, wall: &Wall, radius: f64) -> [f64; WALL_STOPS] {
        let along = (wall.b - wall.a).normalize();
        let normal = Vector2::new(-along.y, along.x);
        let (left, right) =
            (self.meet_line(wall.a, normal, radius), self.meet_line(wall.a, -normal, radius));
        let (a, b) = (self.meet_circle(wall.a, radius), self.meet_circle(wall.b, radius));
        self.in_order(&[left, right, a, b])
    }

    /// [-] The fractions of the path at these `u` in order, with both ends of the path.
    fn in_order<const N: usize>(&self, meets: &[[f64; 2]]) -> [f64; N] {
        let mut stops = [0.0; N];
        for (stop, &u) in stops[2..].iter_mut().zip(meets.as_flattened()) {
            *stop = self.fraction(u);
        }
        stops[1] = 1.0;
        stops.sort_unstable_by(f64::total_cmp);
        stops
    }

    /// The two `u` where the path is `radius` off the line through `point`, on the side of `normal`.
    fn meet_line(&self, point: Point2<f64>, normal: Vector2<f64>, radius: f64) -> [f64; 2] {
        let gap = normal.dot(&(self.start - point)) - radius;
        let squared = gap * self.bend * self.bend / 4.0 + normal.dot(&self.aside) * self.bend / 2.0;
        roots(squared, normal.dot(&self.ahead) / 2.0, gap)
    }

    /// The two `u` where the path is `radius` off `point`.
    fn meet_circle(&self, point: Point2<f64>, radius: f64) -> [f64; 2] {
        let offset = self.start - point;
        let gap = offset.norm_squared() - radius * radius;
        let squared = gap * self.bend * self.bend / 4.0 + offset.dot(&self.aside) * self.bend + 1.0;
        roots(squared, offset.dot(&self.ahead), gap)
    }

    /// [-] The fraction of the path at `u`; 0 or 1 where that is not on the path.
    fn fraction(&self, u: f64) -> f64 {
        let length = if self.bend == 0.0 {
            u
        } else {
            // Beyond half a turn `u` comes from minus infinity.
            let quarter = libm::atan(self.bend * u / 2.0);
            let half = if u < 0.0 { quarter + std::f64::consts::PI } else { quarter };
            2.0 * half / self.bend
        };
        let fraction = length / self.length;
        // NaN, no root at all, becomes 0 as well.
        if fraction > 0.0 { fraction.min(1.0) } else { 0.0 }
    }
}

/// The roots of `squared * u² + 2 * half * u + constant`; NaN where there are none.
fn roots(squared: f64, half: f64, constant: f64) -> [f64; 2] {
    // Not the formula from school, which loses a root's digits when `squared` is small.
    let root = (half * half - squared * constant).sqrt();
    let sum = -(half + root.copysign(half));
    [sum / squared, constant / sum]
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;
    use crate::geometry::oracle;

    const RADIUS: f64 = 0.105;
    const SEED: u64 = 3;

    fn wall(a: [f64; 2], b: [f64; 2]) -> Wall {
        Wall { a: a.into(), b: b.into(), is_solid: false }
    }

    fn arc(x: f64, y: f64, yaw: f64, distance: f64, turn: f64) -> Arc {
        Arc { world_from_base: Isometry2::new(Vector2::new(x, y), yaw), distance, turn }
    }

    /// Drives one arc after another: where the robot is, how near to a wall, collisions so far.
    fn drive(
        walls: &Walls,
        start: Isometry2<f64>,
        way: &[(f64, f64)],
    ) -> (Isometry2<f64>, Contact) {
        let mut world_from_base = start;
        let mut contact = Contact::new(RADIUS, walls, &start);
        for &(distance, turn) in way {
            let arc = Arc { world_from_base, distance, turn };
            world_from_base = arc.at(contact.limit(&arc, walls, &[]));
            contact.arrive(walls, &[], &world_from_base);
        }
        (world_from_base, contact)
    }

    #[test]
    fn contact_is_where_geometry_says() {
        // A wall of 4 m along y at x = 1, a post at its end, an arc, and where it ends: by hand.
        let line = wall([1.0, -2.0], [1.0, 2.0]);
        let quarter = std::f64::consts::FRAC_PI_2;
        let table = [
            (arc(0.0, 0.0, 0.0, 1.79, 0.0), Some((1.0 - RADIUS) / 1.79)),
            (arc(0.0, 0.0, 0.0, 0.89, 0.0), None),
            (arc(0.0, 0.0, 0.0, -5.0, 0.0), None),
            (arc(0.0, 0.0, 2.0 * quarter, -1.79, 0.0), Some((1.0 - RADIUS) / 1.79)),
            // On a circle of radius 1 about (0, 1): x = sin(angle), which is 0.895 at asin(0.895).
            (arc(0.0, 0.0, 0.0, quarter, quarter), Some(libm::asin(1.0 - RADIUS) / quarter)),
            // Of radius 0.895, about the same: it grazes and goes on.
            (arc(0.0, 0.0, 0.0, 4.0 * quarter * 0.895, 4.0 * quarter), None),
            // Behind half a turn: backwards first.
            (
                arc(0.0, 0.0, 2.0 * quarter, 4.0 * quarter, 4.0 * quarter),
                Some(1.0 - (quarter + libm::asin(0.105 - 1.0) + quarter) / (4.0 * quarter)),
            ),
            // Past the end of the wall: Pythagoras with its end.
            (arc(0.0, 2.05, 0.0, 2.0, 0.0), Some((1.0 - (RADIUS * RADIUS - 0.0025).sqrt()) / 2.0)),
            (arc(0.0, 2.106, 0.0, 2.0, 0.0), None),
        ];
        for (case, (arc, expected)) in table.iter().enumerate() {
            let found = Path::new(arc).first_contact(&line, RADIUS);
            let agrees = match (found, expected) {
                (Some(found), Some(expected)) => (found - expected).abs() < 1e-12,
                (found, expected) => found == *expected,
            };
            assert!(agrees, "case {case}: {found:?}, expected {expected:?}");
        }
    }

    /// A wall and an arc that may meet, of any shape from a dot to several turns.
    fn random_case(random: &mut ChaCha8Rng) -> (Wall, Arc) {
        let mut between = |low: f64, high: f64| {
            low + (high - low) * (random.next_u64() >> 11) as f64 * f64::EPSILON / 2.0
        };
        let wall = wall(
            [between(-1.0, 1.0), between(-1.0, 1.0)],
            [between(-1.0, 1.0), between(-1.0, 1.0)],
        );
        let turn = between(-1.0, 1.0) * 10_f64.powf(between(-9.0, 0.7));
        let arc = arc(
            between(-1.0, 1.0),
            between(-1.0, 1.0),
            between(-4.0, 4.0),
            between(-2.0, 2.0),
            turn,
        );
        (wall, arc)
    }

    #[test]
    fn the_robot_touches_at_contact_and_nowhere_before() {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let (mut hits, mut misses) = (0, 0);
        while hits + misses < 20_000 {
            let (wall, arc) = random_case(&mut random);
            let distance = |fraction| wall.distance(arc.at(fraction).translation.vector.into());
            if distance(0.0) <= RADIUS {
                continue;
            }
            let contact = Path::new(&arc).first_contact(&wall, RADIUS);
            let end = contact.unwrap_or(1.0);
            let nearest =
                (0..=200).map(|i| distance(end * f64::from(i) / 200.0)).fold(f64::MAX, f64::min);
            assert!(nearest > RADIUS - 2e-9, "SEED={SEED}: nearest {nearest} of {wall:?}");
            match contact {
                Some(_) => {
                    let gap = distance(end) - RADIUS;
                    assert!(gap.abs() < 1e-12, "SEED={SEED}: stopped {gap} m off {wall:?}");
                    hits += 1;
                }
                None => misses += 1,
            }
        }
        assert!(hits > 1000 && misses > 1000, "SEED={SEED}: {hits} hits, {misses} misses");
    }

    #[test]
    fn parry_agrees_with_the_closed_form() {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let (mut hits, mut overlooked) = (0, 0);
        for _ in 0..10_000 {
            let (wall, arc) = random_case(&mut random);
            // Parry needs a centre of rotation, and a start that is clear.
            if arc.turn.abs() < 1e-3
                || wall.distance(arc.at(0.0).translation.vector.into()) <= RADIUS
            {
                continue;
            }
            let contact = Path::new(&arc).first_contact(&wall, RADIUS);
            let parry = oracle::first_contact(&arc, RADIUS, &wall);
            match (contact, parry) {
                (Some(ours), Some(theirs)) => {
                    assert!((ours - theirs).abs() < 1e-6, "SEED={SEED}: {ours}, parry {theirs}");
                    hits += 1;
                }
                (None, None) => {}
                // Parry's search now and then steps over a contact that is there: the test above
                // holds ours against the path itself.
                (Some(_), None) => overlooked += 1,
                (None, Some(theirs)) => panic!("SEED={SEED}: only parry hits {wall:?}: {theirs}"),
            }
        }
        assert!(hits > 300 && overlooked < hits / 50, "SEED={SEED}: {hits} and {overlooked}");
    }

    /// The same with another robot in the wall's place.
    fn random_meeting(random: &mut ChaCha8Rng) -> (Disc, Arc) {
        let (wall, arc) = random_case(random);
        let radius = 0.01 + 0.3 * f64::from(random.next_u32()) / f64::from(u32::MAX);
        (Disc { centre: wall.a, radius }, arc)
    }

    #[test]
    fn the_robot_touches_another_at_contact_and_nowhere_before() {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let (mut hits, mut misses) = (0, 0);
        while hits + misses < 20_000 {
            let (other, arc) = random_meeting(&mut random);
            let distance = |fraction| other.distance(arc.at(fraction).translation.vector.into());
            if distance(0.0) <= RADIUS {
                continue;
            }
            let contact = Path::new(&arc).first_contact_with(&other, RADIUS);
            let end = contact.unwrap_or(1.0);
            let nearest =
                (0..=200).map(|i| distance(end * f64::from(i) / 200.0)).fold(f64::MAX, f64::min);
            assert!(nearest > RADIUS - 2e-9, "SEED={SEED}: nearest {nearest} of {other:?}");
            match contact {
                Some(_) => {
                    let gap = distance(end) - RADIUS;
                    assert!(gap.abs() < 1e-12, "SEED={SEED}: stopped {gap} m off {other:?}");
                    hits += 1;
                }
                None => misses += 1,
            }
        }
        assert!(hits > 1000 && misses > 1000, "SEED={SEED}: {hits} hits, {misses} misses");
    }

    #[test]
    fn parry_agrees_where_robots_meet() {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let (mut hits, mut overlooked) = (0, 0);
        for _ in 0..20_000 {
            let (other, arc) = random_meeting(&mut random);
            if arc.turn.abs() < 1e-3
                || other.distance(arc.at(0.0).translation.vector.into()) <= RADIUS
            {
                continue;
            }
            let contact = Path::new(&arc).first_contact_with(&other, RADIUS);
            match (contact, oracle::first_contact_with(&arc, RADIUS, &other)) {
                (Some(ours), Some(theirs)) => {
                    assert!((ours - theirs).abs() < 1e-6, "SEED={SEED}: {ours}, parry {theirs}");
                    hits += 1;
                }
                (None, None) => {}
                (Some(_), None) => overlooked += 1,
                (None, Some(theirs)) => panic!("SEED={SEED}: only parry hits {other:?}: {theirs}"),
            }
        }
        assert!(hits > 300 && overlooked < hits / 50, "SEED={SEED}: {hits} and {overlooked}");
    }

    #[test]
    fn no_speed_tunnels_through_four_millimetres() {
        let [left, right] = [0.998, 1.002].map(|x| wall([x, -50.0], [x, 50.0]));
        let walls = Walls::new(vec![left, right]);
        for exponent in -3..7 {
            for turn in [0.0, 1e-9, 1e-3, -0.4, 1.0, -30.0] {
                let distance = 10_f64.powi(exponent);
                let way = vec![(distance, turn); 20];
                let (world_from_base, contact) = drive(&walls, Isometry2::identity(), &way);
                let x = world_from_base.translation.x;
                assert!(x < 0.998 - RADIUS + 1e-9, "{distance} m, {turn} rad: at x = {x}");
                assert!(contact.clearance_min() > -1e-8, "{distance} m, {turn} rad");
            }
        }
    }

    #[test]
    fn pushing_on_is_one_collision_and_backing_off_ends_it() {
        let walls = Walls::new(vec![wall([1.0, -2.0], [1.0, 2.0])]);
        let push = [(0.011, 0.0); 200];
        let mut way = push.to_vec();
        let (world_from_base, contact) = drive(&walls, Isometry2::identity(), &way);
        assert!((world_from_base.translation.x - (1.0 - RADIUS)).abs() < 1e-12);
        assert_eq!(contact.collisions(), 1);

        // Turning on the spot, sliding along and rubbing are the same contact still.
        way.extend([
            (0.0, 1.0),
            (0.0, 0.570_796_326_794_896_6),
            (0.3, 0.0),
            (0.0, -0.5),
            (0.1, 0.0),
        ]);
        let (world_from_base, contact) = drive(&walls, Isometry2::identity(), &way);
        assert!((world_from_base.translation.y - 0.3).abs() < 1e-12, "{world_from_base}");
        assert_eq!(contact.collisions(), 1);

        way.extend([(-0.1, 0.0), (0.2, 0.0), (0.2, 0.0)]);
        let (_, contact) = drive(&walls, Isometry2::identity(), &way);
        assert_eq!(contact.collisions(), 2);
        assert!(contact.clearance_min().abs() < 1e-8, "{}", contact.clearance_min());
    }

    #[test]
    fn creeping_does_not_creep_into_the_wall() {
        let walls = Walls::new(vec![wall([1.0, -2.0], [1.0, 2.0])]);
        let start = Isometry2::translation(1.0 - RADIUS - 1e-6, 0.0);
        for turn in [0.0, 1e-6] {
            let (_, contact) = drive(&walls, start, &vec![(1e-10, turn); 50_000]);
            assert!(contact.clearance_min() > -1e-8, "{}", contact.clearance_min());
            assert_eq!(contact.collisions(), 1);
        }
    }
}
