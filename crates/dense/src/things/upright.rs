//! Upright bounding boxes.

use crate::floor::Floor;
use stillpoint_geometry::{Mat3, Vec3};

/// A box whose third axis is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UprightBox {
    /// Its centre, m, world.
    pub centre: Vec3,
    /// Its sides along its own axes, m; the third is its height.
    pub size: Vec3,
    /// Rotation from its own axes to the world's; the third column is up.
    pub world_from_box: Mat3,
}

/// Share of points left out at each end: depth at object borders is that of the background.
const OUTSIDE: f64 = 0.02;
/// Number of orientations that are tried.
const TURNS: u32 = 30;

impl UprightBox {
    /// The box of the smallest base around nearly all points; `None` for fewer than three.
    pub(crate) fn around(points: &[Vec3], level: &Mat3) -> Option<Self> {
        if points.len() < 3 {
            return None;
        }
        let local: Vec<Vec3> = points.iter().map(|p| level * p).collect();
        let mut values = Vec::with_capacity(local.len());
        let mut range = |of: &dyn Fn(&Vec3) -> f64| {
            values.clear();
            values.extend(local.iter().map(of));
            values.sort_by(f64::total_cmp);
            let cut = (OUTSIDE * values.len() as f64) as usize;
            [values[cut], values[values.len() - 1 - cut]]
        };
        let height = range(&|p| p.z);
        let mut best: Option<(f64, f64, [[f64; 2]; 2])> = None;
        for k in 0..TURNS {
            let turn = std::f64::consts::FRAC_PI_2 * f64::from(k) / f64::from(TURNS);
            let (c, s) = (libm::cos(turn), libm::sin(turn));
            let sides = [range(&|p| c * p.x + s * p.y), range(&|p| c * p.y - s * p.x)];
            let area = (sides[0][1] - sides[0][0]) * (sides[1][1] - sides[1][0]);
            if best.is_none_or(|b| area < b.0) {
                best = Some((area, turn, sides));
            }
        }
        let (_, turn, [along, across]) = best?;
        let (c, s) = (libm::cos(turn), libm::sin(turn));
        let level_from_box = Mat3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        let middle = |r: [f64; 2]| 0.5 * (r[0] + r[1]);
        let world_from_box = level.transpose() * level_from_box;
        Some(Self {
            centre: world_from_box * Vec3::new(middle(along), middle(across), middle(height)),
            size: Vec3::new(
                along[1] - along[0],
                across[1] - across[0],
                height[1] - height[0],
            ),
            world_from_box,
        })
    }

    /// Extends the box down to the floor, if that is less than `most` (m) below it.
    pub(crate) fn on_floor(mut self, floor: &Floor, most: f64) -> Self {
        let up: Vec3 = self.world_from_box.column(2).into();
        let foot = floor.height(&self.centre) - 0.5 * self.size.z;
        if (0.0..most).contains(&foot) {
            self.centre -= 0.5 * foot * up;
            self.size.z += foot;
        }
        self
    }

    /// Extends the sides to include some points horizontally.
    pub(crate) fn reaching(mut self, places: &[Vec3]) -> Self {
        for place in places {
            let local = self.world_from_box.transpose() * (place - self.centre);
            for k in 0..2 {
                let more = local[k].abs() - 0.5 * self.size[k];
                if more > 0.0 {
                    let axis: Vec3 = self.world_from_box.column(k).into();
                    self.size[k] += more;
                    self.centre += 0.5 * more * local[k].signum() * axis;
                }
            }
        }
        self
    }

    /// Whether a world point is inside, or outside by less than a margin (m).
    #[must_use]
    pub fn contains(&self, p: &Vec3, margin: f64) -> bool {
        let local = self.world_from_box.transpose() * (p - self.centre);
        (0..3).all(|k| local[k].abs() <= 0.5 * self.size[k] + margin)
    }

    /// Its longest side, m.
    #[must_use]
    pub fn longest(&self) -> f64 {
        self.size.max()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::so3;

    proptest! {
        /// A turned and tilted box is recovered from points on its faces.
        #[test]
        fn upright_box_is_recovered_from_points(
            size in prop::array::uniform3(0.05..2.0_f64), turn in 0.0..1.57_f64,
            tilt in prop::array::uniform3(-0.4..0.4_f64), at in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let up = so3::exp(&Vec3::from(tilt)).to_rotation_matrix().into_inner();
            let axes = up * so3::exp(&(Vec3::z() * turn)).to_rotation_matrix().into_inner();
            let (size, at) = (Vec3::from(size), Vec3::from(at));
            let mut points = Vec::new();
            for k in 0..3 {
                for side in [-0.5, 0.5] {
                    for i in 0..=10 {
                        for j in 0..=10 {
                            let mut p = Vec3::zeros();
                            p[k] = side;
                            p[(k + 1) % 3] = f64::from(i) / 10.0 - 0.5;
                            p[(k + 2) % 3] = f64::from(j) / 10.0 - 0.5;
                            points.push(at + axes * p.component_mul(&size));
                        }
                    }
                }
            }
            let level = Floor { up: up.column(2).into(), offset: 0.0 }.level_from_world();
            let found = UprightBox::around(&points, &level).unwrap();
            let reach = size.xy().norm();
            prop_assert!((found.centre - at).norm() < 0.04 * reach + 1e-9, "{found:?}");
            prop_assert!((found.size.z - size.z).abs() < 1e-9);
            // Between two tried orientations a side is off by up to half a step.
            let area = (size.x * size.y, found.size.x * found.size.y);
            prop_assert!(area.1 <= area.0 + 0.06 * reach * reach, "{area:?}");
            let turned = found.world_from_box.determinant();
            prop_assert!((turned - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn box_is_robust_to_stray_points() {
        let mut points: Vec<Vec3> = (0..400)
            .map(|i| Vec3::new(f64::from(i % 20), f64::from(i / 20), 0.0) * 0.05)
            .collect();
        let before = UprightBox::around(&points, &Mat3::identity()).unwrap();
        points.extend([Vec3::new(9.0, 9.0, 9.0), Vec3::new(-4.0, 0.0, 1.0)]);
        let after = UprightBox::around(&points, &Mat3::identity()).unwrap();
        assert!((before.centre - after.centre).norm() < 0.03, "{after:?}");
        assert!(UprightBox::around(&points[..2], &Mat3::identity()).is_none());
    }

    #[test]
    fn box_extends_to_outside_points() {
        let seat = UprightBox {
            centre: Vec3::new(1.0, 2.0, 0.5),
            size: Vec3::new(0.4, 0.2, 1.0),
            world_from_box: Mat3::identity(),
        };
        let all = seat.reaching(&[Vec3::new(1.0, 2.5, 0.5), Vec3::new(0.7, 2.0, 0.5)]);
        assert!(
            (all.size - Vec3::new(0.5, 0.6, 1.0)).norm() < 1e-12,
            "{all:?}"
        );
        assert!(
            (all.centre - Vec3::new(0.95, 2.2, 0.5)).norm() < 1e-12,
            "{all:?}"
        );
        // Points inside or above it change nothing.
        assert_eq!(seat.reaching(&[Vec3::new(1.1, 2.05, 3.0)]), seat);
        assert_eq!(seat.reaching(&[]), seat);
    }

    #[test]
    fn box_is_extended_down_to_the_floor() {
        let seat = UprightBox {
            centre: Vec3::new(1.0, 2.0, 0.75),
            size: Vec3::new(0.5, 0.5, 0.5),
            world_from_box: Mat3::identity(),
        };
        let floor = |offset| Floor {
            up: Vec3::z(),
            offset,
        };
        let chair = seat.on_floor(&floor(0.0), 1.0);
        assert!((chair.centre.z - 0.5).abs() < 1e-12 && (chair.size.z - 1.0).abs() < 1e-12);
        // A floor above it or far below it is ignored.
        assert_eq!(seat.on_floor(&floor(0.6), 1.0), seat);
        assert_eq!(seat.on_floor(&floor(-3.0), 1.0), seat);
    }
}
