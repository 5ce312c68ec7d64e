//! Locates an object by its boxes alone.
//!
//! A depth camera hardly measures black or shiny objects, so that no surface matches their boxes. But the left and right borders of boxes
//! from several places are bearings, and determine a square on the floor for an object of similar width and depth.

use super::ends::sides;
use super::look::{Placed, Shown};
use super::own::Seen;
use super::part::{Point, stands};
use crate::floor::Floor;
use std::f64::consts::PI;
use stillpoint_detection::ClassId;
use stillpoint_geometry::nalgebra::{Matrix2, Rotation2};
use stillpoint_geometry::{Mat3, Vec2, Vec3};

/// Maximum ratio of length to width: the appearance of longer objects depends on the viewpoint, and their boxes do not locate them.
const ROUND: f64 = 1.2;
/// Minimum number of views with a detection.
const LEAST_LOOKS: usize = 4;
/// Minimum number of usable borders.
const LEAST_BORDERS: usize = 6;
/// Standard deviation of detected box borders, px.
const JITTER: f64 = 6.0;
/// Error above which a border counts as an outlier, px.
const WRONG: f64 = 2.0 * JITTER;
/// Maximum share of outliers.
const MOST_WRONG: f64 = 0.25;
/// Maximum standard deviation of the position, m.
const CERTAIN: f64 = 0.15;
/// Distance from the image border within which a box counts as cut off, px.
const RIM: f64 = 12.0;
/// Depth difference by which a nearer surface beside a border occludes it, m.
const NEARER: f64 = 0.3;
/// Where occlusion is checked: distance from the border, px, and shares of the box's height.
const BESIDE: f64 = 9.0;
const ROWS: [f64; 3] = [0.2, 0.5, 0.8];
/// Huber threshold, in `JITTER`.
const HUBER: f64 = 1.5;
/// Number of orientations that are tried.
const TURNS: u32 = 6;
/// Maximum number of Gauss-Newton steps; three are usual.
const STEPS: usize = 10;
const FAR: f64 = 6.0;
/// Height of the object's body above the floor, m: that of a seat.
const BODY: f64 = 0.45;
/// Range of object heights, m.
const HEIGHTS: [f64; 2] = [0.5, 2.2];
/// Maximum share of the body's points that views may see through.
const MOST_THROUGH: f64 = 0.4;

#[derive(Clone, Debug)]
pub(crate) struct Standing {
    /// Points on its body, and the corners of its box.
    pub(crate) points: Vec<(Point, Vec3)>,
    pub(crate) seen: Vec<Seen>,
    pub(crate) farthest: f64,
}

/// A square on the floor, in level axes.
#[derive(Clone, Copy, Debug)]
struct Square {
    centre: Vec2,
    /// Half of its side, m.
    half: f64,
    turn: Rotation2<f64>,
}

impl Square {
    /// Offsets from the centre to the corners, for half a side of 1 m.
    fn corners(&self) -> [Vec2; 4] {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        corners.map(|c| self.turn * Vec2::from(c))
    }
}

/// The left or right border of a box, seen from above.
struct Border {
    seen: Seen,
    eye: Vec2,
    /// Direction of the border, and its left normal; unit vectors.
    ahead: Vec2,
    left: Vec2,
    /// 1 where the object is to the right of it, -1 to the left.
    side: f64,
    scale: f64,
    beside: [Vec2; 3],
}

/// Locates an object of a class by its detections; `None` if they do not determine it.
pub(crate) fn standing(
    class: ClassId,
    seen: &[Seen],
    looks: &[Placed<'_>],
    floor: &Floor,
) -> Option<Standing> {
    let [width, length] = sides(class).filter(|_| stands(class))?;
    if length[0] > ROUND * width[0] || seen.len() < LEAST_LOOKS {
        return None;
    }
    let level = floor.level_from_world();
    let borders: Vec<Border> = (seen.iter())
        .flat_map(|s| borders(*s, &looks[s.0], &level))
        .collect();
    let usual = [0, 1].map(|k| 0.25 * (width[k] + length[k]));
    let centre = start(&borders)?;
    let fits = (0..TURNS).filter_map(|k| {
        let turn = 0.5 * PI * f64::from(k) / f64::from(TURNS);
        let first = Square {
            centre,
            half: usual[0],
            turn: Rotation2::new(turn),
        };
        fit(first, usual, &borders, looks, floor)
    });
    let fit = fits.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    let (square, used) = (fit.square, fit.borders);
    let right: Vec<&&Border> = (used.iter())
        .filter(|b| b.error(&square).abs() <= WRONG)
        .collect();
    let wrong = (used.len() - right.len()) as f64;
    let certain = fit.deviation <= CERTAIN;
    if right.len() < LEAST_BORDERS || wrong > MOST_WRONG * used.len() as f64 || !certain {
        return None;
    }
    let own: Vec<Seen> = (seen.iter())
        .filter(|s| right.iter().any(|b| b.seen == **s))
        .copied()
        .collect();
    let middle = at_height(floor, &square.centre, BODY);
    let depths = own.iter().map(|s| looks[s.0].depth(&middle));
    let farthest = depths.fold(0.0, f64::max);
    let top = top(&own, looks, floor, &square.centre)?;
    let (body, corners) = places(&square, top, floor);
    if own.len() < LEAST_LOOKS || farthest > FAR || is_empty(&body, looks, seen[0]) {
        return None;
    }
    let keeper = &looks[own[own.len() / 2].0];
    let kept = body.iter().chain(&corners);
    Some(Standing {
        points: kept
            .filter_map(|p| Some((keeper.keep_world(p)?, *p)))
            .collect(),
        seen: own,
        farthest,
    })
}

/// The borders of a box that the image does not cut off.
fn borders((l, s): Seen, placed: &Placed<'_>, level: &Mat3) -> Vec<Border> {
    let camera = &placed.grid.camera;
    let [x0, y0, x1, y1] = placed.look.sightings[s].bounds.map(f64::from);
    let end = f64::from(camera.width) - 1.0;
    let level_from_camera = level * placed.world_from_camera.rotation.to_rotation_matrix();
    let direction = |x: f64| {
        let ray = level_from_camera * camera.ray(Vec2::new(x, 0.5 * (y0 + y1)));
        ray.xy().try_normalize(1e-9)
    };
    let both = [(x0, x0, -1.0), (x1, end - x1, 1.0)];
    let inside = both.into_iter().filter(|b| b.1 > RIM);
    let border = |(x, _, out): (f64, f64, f64)| {
        let ahead = direction(x)?;
        let left = Rotation2::new(0.5 * PI) * ahead;
        let more = direction(x + 1.0)? - ahead;
        // Negative where larger columns are to the right, as for an upright camera.
        let per_px = more.dot(&left);
        Some(Border {
            seen: (l, s),
            eye: (level * placed.world_from_camera.translation).xy(),
            ahead,
            left,
            side: out * per_px.signum(),
            scale: 1.0 / per_px.abs().max(1e-9),
            beside: ROWS.map(|r| Vec2::new(x + out * BESIDE, y0 + r * (y1 - y0))),
        })
    };
    inside.filter_map(border).collect()
}

impl Border {
    /// The outermost corner of a square, relative to its centre, and its distance outside of the border, px.
    fn outermost(&self, square: &Square) -> (Vec2, f64) {
        let outside = |corner: Vec2| {
            let to = square.centre + square.half * corner - self.eye;
            let angle = libm::atan2(to.dot(&self.left), to.dot(&self.ahead));
            (corner, self.scale * self.side * angle)
        };
        let [first, rest @ ..] = square.corners().map(outside);
        rest.into_iter()
            .fold(first, |a, b| if b.1 > a.1 { b } else { a })
    }

    /// Signed distance of a square outside of the border, px.
    fn error(&self, square: &Square) -> f64 {
        self.outermost(square).1
    }

    /// Derivatives of the error by the centre and half of the side.
    fn slope(&self, square: &Square) -> Vec3 {
        let (corner, _) = self.outermost(square);
        let to = square.centre + square.half * corner - self.eye;
        let across = Rotation2::new(0.5 * PI) * to / to.norm_squared().max(1e-9);
        self.scale * self.side * Vec3::new(across.x, across.y, across.dot(&corner))
    }

    /// Whether something nearer occludes the border of a square.
    fn is_hidden(&self, square: &Square, looks: &[Placed<'_>], floor: &Floor) -> bool {
        let placed = &looks[self.seen.0];
        let z = placed.depth(&at_height(floor, &square.centre, BODY));
        let nearer = |px: &&Vec2| {
            let seen = placed
                .grid
                .nearest(**px)
                .map_or(0.0, |i| placed.look.depth(i));
            seen > 0.0 && seen < z - square.half - NEARER
        };
        let own = &placed.look.sightings[self.seen.1];
        // A black object in front occludes too, with unknown depth: a screen on a table.
        let others = placed
            .look
            .sightings
            .iter()
            .filter(|o| !stands(o.class) && o.track != own.track);
        let covered = |px: &&Vec2| {
            let mut others = others.clone();
            others.any(|o| {
                let [x0, y0, x1, y1] = o.bounds.map(f64::from);
                (x0..x1).contains(&px.x) && (y0..y1).contains(&px.y)
            })
        };
        let hidden = |px: &&Vec2| nearer(px) || covered(px);
        2 * self.beside.iter().filter(hidden).count() > self.beside.len()
    }
}

/// The point closest to all lines of sight.
fn start(borders: &[Border]) -> Option<Vec2> {
    let (mut sum, mut weighted) = (Matrix2::<f64>::zeros(), Vec2::zeros());
    for b in borders {
        let across = b.left * b.left.transpose();
        sum += across;
        weighted += across * b.eye;
    }
    // Regularised for parallel lines.
    let inverse: Matrix2<f64> = (sum + Matrix2::identity() * 1e-6).try_inverse()?;
    Some(inverse * weighted)
}

struct Fit<'a> {
    square: Square,
    borders: Vec<&'a Border>,
    /// The mean Huber cost of errors in `JITTER`.
    cost: f64,
    deviation: f64,
}

fn fit<'a>(
    mut square: Square,
    usual: [f64; 2],
    borders: &'a [Border],
    looks: &[Placed<'_>],
    floor: &Floor,
) -> Option<Fit<'a>> {
    let open = |square: &Square| -> Vec<&Border> {
        let all = borders.iter();
        all.filter(|b| !b.is_hidden(square, looks, floor)).collect()
    };
    let mut deviation = f64::INFINITY;
    for _ in 0..STEPS {
        (square, deviation) = improve(&open(&square), square, usual)?;
    }
    let borders = open(&square);
    let errors = borders.iter().map(|b| b.error(&square) / JITTER);
    let rms = libm::sqrt(errors.map(|e| e * e).sum::<f64>() / borders.len().max(1) as f64);
    deviation *= rms.clamp(0.5, 2.0);
    let costs = borders.iter().map(|b| {
        let error = b.error(&square).abs() / JITTER;
        let beyond = (error - HUBER).max(0.0);
        0.5 * (error * error - beyond * beyond)
    });
    Some(Fit {
        cost: costs.sum::<f64>() / borders.len().max(1) as f64,
        square,
        borders,
        deviation,
    })
}

/// One Gauss-Newton step; returns the standard deviation of the position, m.
fn improve(
    borders: &[&Border],
    mut square: Square,
    [half, spread]: [f64; 2],
) -> Option<(Square, f64)> {
    let (mut normal, mut right) = (Mat3::zeros(), Vec3::zeros());
    normal[(2, 2)] = 1.0 / (spread * spread);
    right.z = (square.half - half) / (spread * spread);
    for b in borders {
        let (error, slope) = (b.error(&square) / JITTER, b.slope(&square) / JITTER);
        let weight = HUBER / error.abs().max(HUBER);
        normal += weight * slope * slope.transpose();
        right += weight * error * slope;
    }
    let inverse = normal.try_inverse()?;
    let step = inverse * right;
    // Limits the step to a metre, and keeps the size positive.
    let step = step * (1.0 / step.norm().max(1.0));
    square.centre -= step.xy();
    square.half = (square.half - step.z).max(0.3 * half);
    // The larger eigenvalue of the position's covariance.
    let [xx, yy, xy] = [(0, 0), (1, 1), (0, 1)].map(|at| inverse[at]);
    let larger = 0.5 * (xx + yy) + libm::hypot(0.5 * (xx - yy), xy);
    Some((square, libm::sqrt(larger)))
}

/// A world point at some height above a point on the floor, m.
fn at_height(floor: &Floor, at: &Vec2, height: f64) -> Vec3 {
    floor.level_from_world().transpose() * Vec3::new(at.x, at.y, floor.offset + height)
}

/// Height of the object by the upper borders of its boxes, m; `None` outside of the valid range.
fn top(seen: &[Seen], looks: &[Placed<'_>], floor: &Floor, centre: &Vec2) -> Option<f64> {
    let level = floor.level_from_world();
    let height = |(l, s): &Seen| {
        let placed = &looks[*l];
        let [x0, y0, x1, _] = placed.look.sightings[*s].bounds.map(f64::from);
        let px = Vec2::new(0.5 * (x0 + x1), y0);
        let ray = level * (placed.world_from_camera.rotation * placed.grid.camera.ray(px));
        let eye = level * placed.world_from_camera.translation;
        let along = (centre - eye.xy()).norm() / ray.xy().norm().max(1e-9);
        (y0 > RIM).then(|| eye.z + along * ray.z - floor.offset)
    };
    let mut heights: Vec<f64> = seen.iter().filter_map(height).collect();
    heights.sort_by(f64::total_cmp);
    let middle = *heights.get(heights.len() / 2)?;
    (HEIGHTS[0]..HEIGHTS[1]).contains(&middle).then_some(middle)
}

/// Points on the body, and the box corners at the body and at the top.
fn places(square: &Square, top: f64, floor: &Floor) -> (Vec<Vec3>, Vec<Vec3>) {
    let corners = square.corners().map(|c| square.half * c);
    let at =
        |share: f64, corner: &Vec2, z: f64| at_height(floor, &(square.centre + share * corner), z);
    let body = [BODY - 0.04, BODY, BODY + 0.04].map(|z| {
        let around = corners
            .iter()
            .flat_map(move |c| [0.3, 0.6].map(|s| at(s, c, z)));
        around
            .chain([at(0.0, &corners[0], z)])
            .collect::<Vec<Vec3>>()
    });
    let ends = corners
        .iter()
        .flat_map(|c| [BODY, top].map(|z| at(1.0, c, z)));
    (body.concat(), ends.collect())
}

fn is_empty(places: &[Vec3], looks: &[Placed<'_>], (l, _): Seen) -> bool {
    let (mut there, mut farther) = (0_u32, 0_u32);
    for placed in looks.iter().filter(|p| p.submap == looks[l].submap) {
        for p in places.iter().filter(|p| placed.depth(p) < FAR) {
            match placed.shows(p) {
                Shown::Point => there += 1,
                Shown::Farther => farther += 1,
                Shown::Nearer | Shown::Nothing => {}
            }
        }
    }
    f64::from(farther) > MOST_THROUGH * f64::from(there + farther)
}

#[cfg(test)]
mod tests;
