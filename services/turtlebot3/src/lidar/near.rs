//! The near filter: drops ranges below a metre that are probably sunshine, after ROBOTIS' driver of
//! the LD08.

use std::f64::consts::TAU;

use super::Point;

/// [m] Only nearer points are looked at.
const NEAR: f64 = 1.0;

/// [m] Neighbours of one group are no farther apart along the ray.
const STEP: f64 = 0.05;

/// [-] A group of more points is a thing.
const GROUP_MAX: usize = 15;

/// [-] The mean confidence that speaks for a thing.
const CONFIDENCE: f64 = 92.0;

/// Drops points of groups that are probably no things. `speed` [degree/s] is the sensor's.
///
/// The driver counts suspicious points over all groups, which its authors cannot have meant; here
/// each group has a count of its own.
pub(super) fn filter(points: &mut [Point], speed: u16) {
    let spacing = (f64::from(speed) / super::lds02::RAY_RATE).to_radians();
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&index| points[index].range < NEAR).collect();
    order.sort_by(|&a, &b| points[a].angle.total_cmp(&points[b].angle));
    for group in groups(points, order, 1.5 * spacing) {
        if !is_thing(points, &group, spacing) {
            for index in group {
                points[index].range = f64::NAN;
            }
        }
    }
}

/// Neighbours by angle and range, joined over straight ahead.
fn groups(points: &[Point], order: Vec<usize>, gap_max: f64) -> Vec<Vec<usize>> {
    let are_neighbours = |a: usize, b: usize| {
        let gap = (points[b].angle - points[a].angle).rem_euclid(TAU);
        gap <= gap_max && (points[b].range - points[a].range).abs() <= STEP
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for index in order {
        match groups.last_mut() {
            Some(group) if group.last().is_some_and(|&last| are_neighbours(last, index)) => {
                group.push(index);
            }
            _ => groups.push(vec![index]),
        }
    }
    let joins = match (groups.last(), groups.first()) {
        (Some(last), Some(first)) if 1 < groups.len() => last
            .last()
            .zip(first.first())
            .is_some_and(|(&last, &first)| are_neighbours(last, first)),
        _ => false,
    };
    if joins && let Some(last) = groups.pop() {
        groups[0].splice(0..0, last);
    }
    groups
}

fn is_thing(points: &[Point], group: &[usize], spacing: f64) -> bool {
    let count = group.len() as f64;
    if GROUP_MAX < group.len() {
        return true;
    }
    let sunny =
        group.iter().filter(|&&index| points[index].intensity & 1 == 1).count() as f64 / count;
    let sum: f64 = group.iter().map(|&index| f64::from(points[index].intensity)).sum();
    let confidence = sum / count;
    if sunny < 0.2 && CONFIDENCE < confidence {
        return true;
    }
    if 0.5 < sunny && confidence < CONFIDENCE {
        return false;
    }
    let nearest = group.iter().map(|&index| points[index].range).fold(f64::INFINITY, f64::min);
    let is_tiny = (confidence < CONFIDENCE && group.len() < 5) || (0.9 < sunny && group.len() < 3);
    if nearest < 0.3 && is_tiny {
        return false;
    }
    let ends = group.first().zip(group.last());
    let span = ends
        .map_or(0.0, |(&first, &last)| (points[last].angle - points[first].angle).rem_euclid(TAU));
    let gap = if group.len() < 2 { spacing } else { span / (count - 1.0) };
    spacing - 0.2_f64.to_radians() < gap
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turn of 230 points, all far but those from `first` on.
    fn turn(first: usize, ranges: &[f64], intensity: u16) -> Vec<Point> {
        (0..230)
            .map(|index| {
                let near = (index + 230 - first) % 230;
                let range = ranges.get(near).copied().unwrap_or(3.0);
                let intensity = if near < ranges.len() { intensity } else { 200 };
                Point { angle: index as f64 * TAU / 230.0, range, intensity }
            })
            .collect()
    }

    fn left(first: usize, ranges: &[f64], intensity: u16) -> usize {
        let mut points = turn(first, ranges, intensity);
        filter(&mut points, 3600);
        points.iter().filter(|point| point.range < NEAR).count()
    }

    #[test]
    fn walls_stay_and_sunshine_goes() {
        let table = [
            // A wall is large, however faint.
            (100, vec![0.2; 40], 11, 40),
            // A leg is small and sure.
            (100, vec![0.5; 4], 200, 4),
            // Sunshine is faint and says so.
            (100, vec![0.5; 4], 11, 0),
            (100, vec![0.2], 10, 0),
            // Over straight ahead, a wall is one group.
            (222, vec![0.2; 16], 11, 16),
            // Two things at different ranges are two groups.
            (100, [vec![0.3; 9], vec![0.5; 9]].concat(), 11, 0),
        ];
        for (first, ranges, intensity, expected) in table {
            let count = left(first, &ranges, intensity);
            assert_eq!(count, expected, "{first} {ranges:?} {intensity}");
        }
    }
}
