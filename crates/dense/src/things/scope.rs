//! Maximum size of objects: connected points beyond it belong to something else.

use super::carve::{Cell, evenly, fit, goes_on};
use super::part::stands;

use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;

/// Longest horizontal sides, m: of the largest products for homes and offices. For other classes the boxes suffice.
const LONGEST: [(&str, f64); 9] = [
    ("chair", 0.8),
    ("toilet", 0.8),
    ("oven", 1.0),
    ("microwave", 0.7),
    ("refrigerator", 1.0),
    ("bench", 2.0),
    ("couch", 3.0),
    ("bed", 2.3),
    ("dining table", 3.0),
];
/// Classes that may be seen along their length.
const LONG: [&str; 4] = ["bench", "couch", "bed", "dining table"];
/// Maximum depth extent of an object, as a multiple of the width or height of its box.
const DEEP: f64 = 1.5;
/// Maximum depth extent of an object of [`LONG`], as a multiple of the width or height of its box.
const DEEP_IF_LONG: f64 = 3.0;
/// Ratio of the diagonal to the longest side.
const DIAGONAL: f64 = 1.2;
/// Number of centres that are tried in an oversized component.
const MIDDLES: usize = 40;
/// Penalty of points whose surface continues beyond the borders of the boxes, relative to the fit.
const GOES_ON: f64 = 0.5;
/// Doubt below which components are not cut: noise and the ground at an object's foot look like a continuing surface.
const LEAST_DOUBT: f64 = 0.15;
/// Diameters that are tried, as shares of the largest one; of equals the first.
const SHARES: [f64; 4] = [1.0, 0.85, 0.7, 0.55];

/// The maximum horizontal diameter of a class; `None` for classes of variable size.
pub(crate) fn largest(class: ClassId) -> Option<f64> {
    let longest = LONGEST.iter().find(|l| l.0 == class.name())?;
    Some(DIAGONAL * longest.1)
}

/// Size limits of an object before its points are known.
pub(crate) struct Scope<'a> {
    pub(crate) class: ClassId,
    /// Up, if the floor is known; otherwise distances count in all directions.
    pub(crate) up: Option<Vec3>,
    pub(crate) boxes: &'a [Option<[f32; 4]>],
    /// By compared box, its size at the depth of a point, m.
    pub(crate) sides: &'a dyn Fn(&Vec3) -> Vec<f64>,
}

impl Scope<'_> {
    /// The maximum horizontal diameter of the object at a point, m.
    fn diameter(&self, at: &Vec3) -> f64 {
        let mut sides = (self.sides)(at);
        sides.sort_by(f64::total_cmp);
        let side = sides.get(sides.len() / 2).copied().unwrap_or(0.0);
        let long = LONG.contains(&self.class.name());
        let deep = if long { DEEP_IF_LONG } else { DEEP };
        largest(self.class)
            .unwrap_or(f64::INFINITY)
            .min(deep * side)
    }

    fn apart(&self, a: &Vec3, b: &Vec3) -> f64 {
        let gap = a - b;
        let up = |up: Vec3| gap - gap.dot(&up) * up;
        self.up.map_or(gap, up).norm()
    }

    /// Doubt that some points are background, by where they continue, weighted against the fit. None for long objects and for those on
    /// others, as desks stand in rows and books lie on desks.
    pub(crate) fn doubt(&self, cells: &[Cell], members: &[usize]) -> f64 {
        let ends = stands(self.class) && !LONG.contains(&self.class.name());
        if ends {
            GOES_ON * goes_on(cells, members)
        } else {
            0.0
        }
    }

    pub(crate) fn holds(&self, cells: &[Cell], members: &[usize]) -> bool {
        let middle = middle(cells, members);
        let radius = 0.5 * self.diameter(&middle);
        let near = |i: &usize| self.apart(&cells[*i].at, &middle) <= radius;
        members.iter().all(near)
    }

    /// For an oversized or doubtful component, its part with the best fit; otherwise the component.
    pub(crate) fn cut(&self, cells: &[Cell], piece: Vec<usize>) -> Vec<usize> {
        if self.holds(cells, &piece) && self.doubt(cells, &piece) < LEAST_DOUBT {
            return piece;
        }
        let places: Vec<Vec3> = piece.iter().map(|i| cells[*i].at).collect();
        let mut best: Option<(f64, Vec<usize>)> = None;
        for k in evenly(&places, MIDDLES) {
            self.try_around(&places[k], cells, &piece, &mut best);
        }
        if let Some((_, part)) = &best {
            let middle = middle(cells, part);
            self.try_around(&middle, cells, &piece, &mut best);
        }
        best.map_or(piece, |b| b.1)
    }

    fn try_around(
        &self,
        middle: &Vec3,
        cells: &[Cell],
        piece: &[usize],
        best: &mut Option<(f64, Vec<usize>)>,
    ) {
        let most = 0.5 * self.diameter(middle);
        for share in SHARES {
            let near = |i: &usize| self.apart(&cells[*i].at, middle) <= share * most;
            let part: Vec<usize> = piece.iter().copied().filter(near).collect();
            let fit = fit(cells, &part, self.boxes);
            let fit = fit - self.doubt(cells, &part);
            if !part.is_empty() && best.as_ref().is_none_or(|b| fit > b.0) {
                *best = Some((fit, part));
            }
        }
    }
}

fn middle(cells: &[Cell], members: &[usize]) -> Vec3 {
    let far = Vec3::repeat(f64::INFINITY);
    let (low, high) = members.iter().fold((far, -far), |(low, high), i| {
        (low.inf(&cells[*i].at), high.sup(&cells[*i].at))
    });
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chair half a metre wide and deep at x = 0, from which a row of points leads to something two metres behind it.
    #[test]
    fn points_connected_to_a_chair_are_cut_off() {
        let at = |x: f64, z: f64| Vec3::new(x, 0.0, z);
        let mut places: Vec<Vec3> = Vec::new();
        for i in 0..=10 {
            let x = 0.05 * f64::from(i) - 0.25;
            places.extend((0..=10).map(|k| at(x, 2.0 + 0.05 * f64::from(k))));
            places.push(at(0.25, 2.5 + 0.15 * f64::from(i)));
        }
        let pixel = |p: &Vec3| [(500.0 * p.x / p.z) as f32, 0.0];
        let cells: Vec<Cell> = places
            .iter()
            .map(|p| Cell::in_one_look(*p, pixel(p)))
            .collect();
        let all: Vec<usize> = (0..cells.len()).collect();
        let reach = |members: &[usize]| {
            let depths = members.iter().map(|i| places[*i].z);
            depths.fold(0.0, f64::max)
        };
        let cut = |class: &str| {
            let scope = Scope {
                class: ClassId::from_name(class).unwrap(),
                up: Some(Vec3::y()),
                boxes: &[Some([-62.0, -8.0, 62.0, 8.0])],
                sides: &|at| vec![124.0 / 500.0 * at.z],
            };
            assert_eq!(scope.holds(&cells, &all), class == "dining table");
            scope.cut(&cells, all.clone())
        };
        let chair = cut("chair");
        let sides = chair.iter().map(|i| places[*i].x);
        let (left, right) = sides.fold((0.0, 0.0), |(a, b): (f64, f64), x| (a.min(x), b.max(x)));
        assert!(left < -0.2 && right > 0.2, "{left} {right}");
        assert!(reach(&chair) < 3.2, "{}", reach(&chair));
        // Control: a table may be that long.
        assert_eq!(cut("dining table").len(), all.len());
        assert!(reach(&all) > 3.9);
    }

    /// A chair connected to a shelf behind it, both as wide as its box.
    #[test]
    fn shelf_behind_a_chair_is_cut_off() {
        let mut cells = Vec::new();
        for i in 0..=10 {
            for k in 0..=14 {
                let at = Vec3::new(0.03 * f64::from(i) - 0.15, 0.0, 2.0 + 0.05 * f64::from(k));
                let pixel = [(500.0 * at.x / at.z) as f32, 0.0];
                cells.push((at.z, Cell::in_one_look(at, pixel)));
            }
        }
        let places: Vec<f64> = cells.iter().map(|c| c.0).collect();
        let all: Vec<usize> = (0..places.len()).collect();
        let cut = |class: &str, shelf: bool| {
            let cells: Vec<Cell> = (cells.iter())
                .map(|(z, c)| c.clone().at_border(shelf && *z > 2.3))
                .collect();
            let scope = Scope {
                class: ClassId::from_name(class).unwrap(),
                up: Some(Vec3::y()),
                boxes: &[Some([-38.0, -8.0, 38.0, 8.0])],
                sides: &|_| vec![0.7],
            };
            assert!(scope.holds(&cells, &all));
            let part = scope.cut(&cells, all.clone());
            let depths = part.iter().map(|i| places[*i]);
            depths.fold(0.0, f64::max)
        };
        assert!(cut("chair", true) < 2.45, "{}", cut("chair", true));
        // Controls: a surface that ends with its boxes is kept, and desks stand in rows.
        assert!(cut("chair", false) > 2.69);
        assert!(cut("dining table", true) > 2.69);
    }
}
