//! Estimates the extent of an object on its unseen sides.
//!
//! A side of its box is final where cameras saw empty space beyond it. Elsewhere it extends to the usual size of its class, but not into
//! empty space. Otherwise the centre of the box would lie on the visible surface.

use super::look::{Placed, Shown, tolerance};
use super::upright::UprightBox;
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;

/// Mean and standard deviation of the shorter and of the longer horizontal side, m: of products for homes and offices.
const SIZES: [(&str, [[f64; 2]; 2]); 10] = [
    ("chair", [[0.55, 0.08], [0.6, 0.08]]),
    ("dining table", [[0.8, 0.1], [1.5, 0.3]]),
    ("couch", [[0.9, 0.1], [1.9, 0.4]]),
    ("bed", [[1.4, 0.4], [2.05, 0.1]]),
    ("bench", [[0.45, 0.08], [1.4, 0.3]]),
    ("toilet", [[0.38, 0.03], [0.65, 0.06]]),
    ("oven", [[0.6, 0.04], [0.6, 0.08]]),
    ("refrigerator", [[0.6, 0.06], [0.65, 0.08]]),
    ("microwave", [[0.35, 0.05], [0.5, 0.05]]),
    ("suitcase", [[0.27, 0.05], [0.45, 0.08]]),
];
/// Step of the checked places beyond a side, m.
const STEP: f64 = 0.05;
/// Share of empty places beyond a side from which it is final.
const FREE: f64 = 0.5;
/// Number of views that must show a place as empty: at object borders, depth is sometimes that of the background.
const LEAST_LOOKS: usize = 2;
/// Maximum number of views used: more add nothing.
const MOST_LOOKS: usize = 100;
/// Maximum distance of views, m; farther ones are too coarse.
const FAR: f64 = 5.0;
/// Places across a side, and over its height, as shares of the box.
const ACROSS: [f64; 5] = [-0.4, -0.2, 0.0, 0.2, 0.4];
const HEIGHTS: [f64; 3] = [0.0, 0.2, 0.4];
/// Thickness of a table top, m: the space below it is empty.
const TOP: f64 = 0.015;

/// Extensions below this are ignored, m.
const LEAST: f64 = 0.01;

/// By horizontal axis, the possible extension beyond the lower and the upper side, m.
pub(crate) type Rooms = [[f64; 2]; 2];

/// Mean and standard deviation of the shorter and of the longer side for a class, m.
pub(crate) fn sides(class: ClassId) -> Option<[[f64; 2]; 2]> {
    SIZES.iter().find(|s| s.0 == class.name()).map(|s| s.1)
}

/// Centres of the sides of the extended box; `known` are boxes that limit the extension.
pub(crate) fn complete(
    class: ClassId,
    bounds: &UprightBox,
    known: &[UprightBox],
    looks: &[&Placed<'_>],
) -> Vec<Vec3> {
    let Some(sizes) = sides(class) else {
        return Vec::new();
    };
    let most = sizes[1][0] + 3.0 * sizes[1][1];
    let mut rooms = rooms(class, bounds, most, looks);
    within(known, bounds, &mut rooms);
    let all = grown(bounds, &rooms, &sizes);
    let mut ends = Vec::new();
    for (k, sign) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)] {
        let axis: Vec3 = sign * bounds.world_from_box.column(k);
        let side = |b: &UprightBox| b.centre + 0.5 * b.size[k] * axis;
        let (seen, end) = (side(bounds), side(&all));
        if (end - seen).dot(&axis) > LEAST {
            ends.push(end);
        }
    }
    ends
}

fn within(known: &[UprightBox], bounds: &UprightBox, rooms: &mut Rooms) {
    for (k, sign) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)] {
        let axis: Vec3 = sign * bounds.world_from_box.column(k);
        let reach = |b: &UprightBox| {
            let sides = b.world_from_box.transpose() * axis;
            b.centre.dot(&axis) + 0.5 * sides.abs().dot(&b.size)
        };
        let room = &mut rooms[k][usize::from(sign > 0.0)];
        for other in known {
            *room = room.min((reach(other) - reach(bounds)).max(0.0));
        }
    }
}

/// The box of expected size, at least the seen one and within the possible extension.
fn grown(bounds: &UprightBox, rooms: &Rooms, sizes: &[[f64; 2]; 2]) -> UprightBox {
    let likely = |turned: usize| -> f64 {
        let of = |k: usize| likelihood(bounds.size[k], rooms[k], sizes[k ^ turned]);
        of(0) + of(1)
    };
    let straight = bounds.size.x <= bounds.size.y;
    let (same, other) = (usize::from(!straight), usize::from(straight));
    let turned = if likely(other) > likely(same) {
        other
    } else {
        same
    };
    let mut all = *bounds;
    for k in 0..2 {
        let [low, high] = rooms[k];
        let more = expected(bounds.size[k], low + high, sizes[k ^ turned]) - bounds.size[k];
        if more <= 0.0 {
            continue;
        }
        let shift = 0.5 * more * (high - low) / (low + high);
        let axis: Vec3 = bounds.world_from_box.column(k).into();
        all.size[k] += more;
        all.centre += shift * axis;
    }
    all
}

fn below(x: f64) -> f64 {
    0.5 * (1.0 + libm::erf(x * std::f64::consts::FRAC_1_SQRT_2))
}

fn density(x: f64) -> f64 {
    libm::exp(-0.5 * x * x) / libm::sqrt(2.0 * std::f64::consts::PI)
}

/// Log likelihood of a side with this seen size and possible extension.
fn likelihood(size: f64, [low, high]: [f64; 2], [mean, deviation]: [f64; 2]) -> f64 {
    let least = (size - mean) / deviation;
    // The seen size is exact to some centimetres.
    let most = (size + low + high + STEP - mean) / deviation;
    libm::log((below(most) - below(least)).max(1e-9))
}

/// The mean of a normal distribution truncated between the seen size and the possible one.
fn expected(size: f64, room: f64, [mean, deviation]: [f64; 2]) -> f64 {
    let (a, b) = ((size - mean) / deviation, (size + room - mean) / deviation);
    let between = below(b) - below(a);
    if room <= 0.0 || between < 1e-6 {
        return if b < 0.0 { size + room.max(0.0) } else { size };
    }
    let at = mean + deviation * (density(a) - density(b)) / between;
    at.clamp(size, size + room)
}

fn rooms(class: ClassId, bounds: &UprightBox, most: f64, looks: &[&Placed<'_>]) -> Rooms {
    let near: Vec<(&Placed<'_>, f64)> = looks
        .iter()
        .filter_map(|l| l.project(&bounds.centre).map(|(_, z)| (*l, z)))
        .filter(|(_, z)| *z < FAR)
        .collect();
    let every = near.len().div_ceil(MOST_LOOKS).max(1);
    let asked: Vec<(&Placed<'_>, f64)> = near.into_iter().step_by(every).collect();
    let depth = asked.iter().map(|a| a.1).fold(FAR, f64::min);
    // Closer to a surface the depth is inconclusive.
    let blur = tolerance(depth);
    let table = class.name() == "dining table";
    let side = |k: usize, sign: f64| {
        let room = (most - bounds.size[k]).max(0.0);
        let mut beyond = 0.0;
        while beyond < room {
            let at = sign * (0.5 * bounds.size[k] + blur + beyond);
            let places = places(bounds, k, at, table);
            let free = places.iter().filter(|p| is_free(p, &asked)).count();
            if free as f64 >= FREE * places.len() as f64 {
                break;
            }
            beyond += STEP;
        }
        beyond.min(room)
    };
    [0, 1].map(|k| [side(k, -1.0), side(k, 1.0)])
}

fn places(bounds: &UprightBox, k: usize, at: f64, table: bool) -> Vec<Vec3> {
    let top = [0.5 * bounds.size.z - TOP];
    let heights = HEIGHTS.map(|h| h * bounds.size.z);
    let heights: &[f64] = if table { &top } else { &heights };
    let mut places = Vec::with_capacity(ACROSS.len() * heights.len());
    for share in ACROSS {
        for z in heights {
            let mut local = Vec3::zeros();
            local[k] = at;
            local[1 - k] = share * bounds.size[1 - k];
            local.z = *z;
            places.push(bounds.centre + bounds.world_from_box * local);
        }
    }
    places
}

fn is_free(place: &Vec3, looks: &[(&Placed<'_>, f64)]) -> bool {
    let free = looks.iter().filter(|l| l.0.shows(place) == Shown::Farther);
    free.take(LEAST_LOOKS).count() == LEAST_LOOKS
}

#[cfg(test)]
mod tests {
    use super::super::look::{Grid, Look};
    use super::*;
    use crate::kept::Anchor;
    use stillpoint_geometry::{Camera, Mat3, Se3, so3};

    fn grid() -> Grid {
        Grid::new(&Camera::pinhole(640, 480, [525.0, 525.0, 320.0, 240.0]))
    }

    /// The visible surface of a chair: half a metre wide, one high, 2 m before the first camera; z is up.
    const SHEET: [f64; 3] = [0.5, 0.02, 1.0];

    fn sheet() -> UprightBox {
        UprightBox {
            centre: Vec3::new(0.0, 2.0, 0.5),
            size: Vec3::from(SHEET),
            world_from_box: Mat3::identity(),
        }
    }

    /// The view of a camera whose background wall is 4 m away.
    fn look(grid: &Grid, pose: &Se3) -> Look {
        let sheet = sheet();
        let depth = |i: usize| {
            let ray = grid.camera.backproject(grid.pixel(i), 1.0);
            let steps = (20..400).map(|k| 0.01 * f64::from(k));
            let mut hits = steps.filter(|z| sheet.contains(&pose.transform(&(ray * *z)), 0.0));
            (1000.0 * hits.next().unwrap_or(4.0)) as u16
        };
        Look {
            stamp: 0.0,
            anchor: Anchor {
                own: None,
                reference: None,
                online: *pose,
                submap: None,
            },
            depths: (0..grid.columns * grid.rows).map(depth).collect(),
            sightings: Vec::new(),
        }
    }

    /// A camera at a position, looking horizontally, turned by `turn` from y to -x.
    fn pose(at: [f64; 3], turn: f64) -> Se3 {
        let ahead = so3::exp(&(-Vec3::x() * std::f64::consts::FRAC_PI_2));
        Se3::new(so3::exp(&(Vec3::z() * turn)) * ahead, Vec3::from(at))
    }

    fn completed(class: &str, known: &[UprightBox], poses: &[Se3]) -> UprightBox {
        let grid = grid();
        let looks: Vec<Look> = poses.iter().map(|p| look(&grid, p)).collect();
        let placed = looks.iter().zip(poses);
        // Each view occurs twice.
        let placed: Vec<Placed<'_>> = placed
            .flat_map(|(l, p)| [Placed::at(l, &grid, *p), Placed::at(l, &grid, *p)])
            .collect();
        let placed: Vec<&Placed<'_>> = placed.iter().collect();
        let class = ClassId::from_name(class).unwrap();
        sheet().reaching(&complete(class, &sheet(), known, &placed))
    }

    #[test]
    fn chair_seen_from_one_side_is_extended_behind() {
        let front = pose([0.0, 0.0, 0.8], 0.0);
        let chair = completed("chair", &[], &[front]);
        let near = chair.centre.y - 0.5 * chair.size.y;
        assert!((near - 1.99).abs() < 0.01, "{chair:?}");
        assert!((0.5..0.7).contains(&chair.size.y), "{chair:?}");
        assert!((chair.size.x - 0.5).abs() < 0.05 && chair.centre.x.abs() < 0.02);
        assert!((chair.size.z - 1.0).abs() < 1e-12);
        // Controls: the space behind it was seen empty, and screens are as thin as they look.
        let side = pose([2.0, 2.3, 0.8], std::f64::consts::FRAC_PI_2);
        let thin = completed("chair", &[], &[front, side]);
        assert!(thin.size.y < 0.1, "{thin:?}");
        assert_eq!(completed("tv", &[], &[front]), sheet());
        // An end seen by an earlier run is used.
        assert_eq!(completed("chair", &[sheet()], &[front]), sheet());
    }

    #[test]
    fn unviewed_sides_get_the_usual_size_of_the_class() {
        let chair = completed("chair", &[], &[]);
        assert!((chair.centre - sheet().centre).norm() < 1e-9);
        assert!((0.5..0.75).contains(&chair.size.x) && (0.5..0.75).contains(&chair.size.y));
    }

    #[test]
    fn expected_size_is_between_seen_size_and_free_space() {
        let desk = [0.8, 0.1];
        assert!((expected(0.3, 2.0, desk) - 0.8).abs() < 1e-3);
        // No space, little space, and more than usual.
        assert!((expected(0.3, 0.0, desk) - 0.3).abs() < 1e-12);
        let little = expected(0.3, 0.1, desk);
        assert!((0.37..=0.4).contains(&little), "{little}");
        let large = expected(0.95, 2.0, desk);
        assert!(large > 0.95 && large < 1.02, "{large}");
        assert!((expected(2.0, 1.0, desk) - 2.0).abs() < 1e-12);
        // A metre of a desk's length and half of its depth were seen, or the other way round.
        let seen = |size: [f64; 2], rooms| {
            let bounds = UprightBox {
                size: Vec3::new(size[0], size[1], 0.74),
                ..sheet()
            };
            grown(&bounds, &rooms, &[desk, [1.5, 0.3]]).size
        };
        let free = [0.0, 2.0];
        let desk = seen([1.0, 0.5], [free, free]);
        assert!(
            (desk.x - 1.5).abs() < 0.1 && (desk.y - 0.8).abs() < 0.02,
            "{desk}"
        );
        // A side seen to end after 0.8 m is the shorter one, though it looks longer.
        let desk = seen([0.8, 0.6], [[0.0; 2], free]);
        assert!((desk.x - 0.8).abs() < 1e-9 && desk.y > 1.3, "{desk}");
    }
}
