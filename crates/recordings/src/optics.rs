//! Camera models of recordings: projection with each lens model.

use crate::decode::Bad;
use stillpoint_geometry::{BrownConrady, Camera, Vec2};
use stillpoint_ros_messages::CameraInfo;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Lens {
    /// `plumb_bob`: supported by the SLAM system itself.
    Brown(BrownConrady),
    /// `rational_polynomial`: k1 k2 p1 p2 k3 k4 k5 k6 of OpenCV.
    Rational([f64; 8]),
    /// `equidistant`: k1 to k4 of Kannala and Brandt, as in OpenCV's fisheye model.
    Equidistant([f64; 4]),
    /// Brown's polynomial from pixels to rays, as RealSense uses it for infrared cameras.
    InverseBrown(BrownConrady),
}

impl Lens {
    /// From the model name in a recording. Without coefficients there is no distortion, whatever the name.
    ///
    /// # Errors
    /// A description of an unknown model.
    pub(crate) fn new(model: &str, d: &[f64]) -> Result<Self, String> {
        if d.iter().any(|k| !k.is_finite()) {
            return Err(format!("{model} with {d:?}"));
        }
        if d.iter().all(|k| *k == 0.0) {
            return Ok(Self::Brown(BrownConrady::default()));
        }
        let at = |i: usize| d.get(i).copied().unwrap_or(0.0);
        let brown = BrownConrady {
            k1: at(0),
            k2: at(1),
            p1: at(2),
            p2: at(3),
            k3: at(4),
        };
        let rest = |n: usize| d.iter().skip(n).any(|k| *k != 0.0);
        match model.to_lowercase().replace([' ', '-'], "_").as_str() {
            "plumb_bob" | "radtan" | "brown_conrady" | "" if !rest(5) => Ok(Self::Brown(brown)),
            "rational_polynomial" if !rest(5) => Ok(Self::Brown(brown)),
            // In RealSense's modified model the tangential terms act on the radially distorted point, as in the inverse model.
            "modified_brown_conrady" | "inverse_brown_conrady" if !rest(5) => {
                Ok(Self::InverseBrown(brown))
            }
            "rational_polynomial" if !rest(8) => Ok(Self::Rational(std::array::from_fn(at))),
            "equidistant" | "fisheye" | "kannala_brandt" | "kannala_brandt4" if !rest(4) => {
                Ok(Self::Equidistant(std::array::from_fn(at)))
            }
            _ => Err(format!("{model} with {} coefficients", d.len())),
        }
    }

    /// From normalised coordinates of the ray to those in the image.
    pub(crate) fn distort(&self, p: Vec2) -> Vec2 {
        match self {
            Self::Brown(b) => b.distort(p),
            Self::InverseBrown(b) => b.undistort(p),
            Self::Rational([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let (x, y) = (p.x, p.y);
                let r2 = x * x + y * y;
                let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
                let radial = above / below;
                Vec2::new(
                    x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                    y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
                )
            }
            Self::Equidistant([k1, k2, k3, k4]) => {
                let r = p.norm();
                if r < 1e-12 {
                    return p;
                }
                let theta = r.atan();
                let t2 = theta * theta;
                let bent = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
                p * (bent / r)
            }
        }
    }

    /// The inverse of [`Self::distort`], by Newton's method with numeric derivatives where there is no closed form.
    pub(crate) fn undistort(&self, p: Vec2) -> Vec2 {
        match self {
            Self::Brown(b) => b.undistort(p),
            Self::InverseBrown(b) => b.distort(p),
            _ => self.solve(p),
        }
    }

    /// The derivative of [`Self::distort`] along x and along y, by differences.
    fn slopes(&self, q: Vec2) -> (Vec2, Vec2) {
        const STEP: f64 = 1e-6;
        let along = |step: Vec2| (self.distort(q + step) - self.distort(q - step)) / (2.0 * STEP);
        (along(Vec2::new(STEP, 0.0)), along(Vec2::new(0.0, STEP)))
    }

    /// Whether the model is monotonic up to this ray, with bounded stretch. A model that folds is invertible up to the fold, where the
    /// determinant of its derivative becomes 0.
    fn is_sound_to(&self, ray: Vec2) -> bool {
        (1..=STEPS).all(|k| {
            let q = ray * (f64::from(k) / f64::from(STEPS));
            let (u, v) = self.slopes(q);
            let stretch = self.distort(q).norm() / q.norm().max(f64::MIN_POSITIVE);
            // Rejects NaN; a mirror image would have a positive determinant too.
            u.x * v.y - u.y * v.x > 0.0 && u.x + v.y > 0.0 && stretch <= MAX_STRETCH
        })
    }

    fn solve(&self, p: Vec2) -> Vec2 {
        let mut q = p;
        for _ in 0..20 {
            let e = self.distort(q) - p;
            let (u, v) = self.slopes(q);
            let det = u.x * v.y - u.y * v.x;
            let step = Vec2::new(v.y * e.x - v.x * e.y, u.x * e.y - u.y * e.x) / det;
            if !step.iter().all(|s| s.is_finite()) {
                break;
            }
            q -= step;
            if step.norm_squared() < 1e-24 {
                break;
            }
        }
        q
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Optics {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// fx, fy, cx, cy, px.
    pub(crate) k: [f64; 4],
    pub(crate) lens: Lens,
}

/// Number of samples along each side of the image, and from the optical axis to each of them, at which a lens is checked.
const SAMPLES: u32 = 32;
const STEPS: u32 = 16;
/// Maximum stretch of an image by a lens, relative to a pinhole. Wide lenses with drawn-out corners reach 1.2.
const MAX_STRETCH: f64 = 1.5;

/// fx, fy, cx, cy of a matrix K or P with rows of this length; `None` if the focal lengths are not set.
fn figures(matrix: &[f64], row: usize) -> Option<[f64; 4]> {
    let k = [matrix[0], matrix[row + 1], matrix[2], matrix[row + 2]];
    (k[0] > 0.0 && k[1] > 0.0).then_some(k)
}

/// Whether a camera info holds a calibration; drivers that are not ready send zeros.
#[must_use]
pub fn is_calibrated(info: &CameraInfo<'_>) -> bool {
    figures(&info.k, 3).is_some() || figures(&info.p, 4).is_some()
}

/// Whether its values are possible for a camera of the stated size.
pub(crate) fn is_plausible(info: &CameraInfo<'_>) -> bool {
    Optics::new(info, false).is_ok_and(|optics| optics.check().is_ok())
}

impl Optics {
    /// From a camera info, ignoring region and binning; `rectified`: the images are undistorted, so that the projection matrix holds.
    ///
    /// # Errors
    /// A description of a missing calibration.
    pub(crate) fn new(info: &CameraInfo<'_>, rectified: bool) -> Result<Self, String> {
        let (own, projection) = (figures(&info.k, 3), figures(&info.p, 4));
        let (k, lens) = match (own, projection) {
            (_, Some(k)) | (Some(k), None) if rectified => {
                (k, Lens::Brown(BrownConrady::default()))
            }
            // P replaces a missing K: for a monocular camera they are equal.
            (Some(k), _) | (None, Some(k)) => (k, Lens::new(&info.distortion_model, &info.d)?),
            (None, None) => {
                return Err(format!(
                    "fx = {:?}, fy = {:?} px in K and fx = {:?}, fy = {:?} px in P",
                    info.k[0], info.k[4], info.p[0], info.p[5]
                ));
            }
        };
        Ok(Self {
            width: info.width,
            height: info.height,
            k,
            lens,
        })
    }

    /// Checks the values, and that the lens is invertible within the image.
    ///
    /// # Errors
    /// The first impossible value.
    pub(crate) fn check(&self) -> Result<(), Bad> {
        let checked = self.camera().check();
        checked.map_err(|e| Bad::new(e.expected(), e.found()))?;
        if !self.needs_rectifying() {
            return Ok(());
        }
        let [fx, fy, cx, cy] = self.k;
        let place = |i: u32, side: u32| f64::from(i) / f64::from(SAMPLES) * f64::from(side - 1);
        for j in 0..=SAMPLES {
            for i in 0..=SAMPLES {
                let (u, v) = (place(i, self.width), place(j, self.height));
                let ray = Vec2::new((u - cx) / fx, (v - cy) / fy);
                if !self.lens.is_sound_to(ray) {
                    return Err(Bad::new(
                        "a lens model that can be inverted within the image",
                        format!("one that cannot at pixel ({u:.0}, {v:.0}), {:?}", self.lens),
                    ));
                }
            }
        }
        Ok(())
    }

    pub(crate) fn of_camera(camera: &Camera) -> Self {
        Self {
            width: camera.width,
            height: camera.height,
            k: [camera.fx, camera.fy, camera.cx, camera.cy],
            lens: Lens::Brown(camera.distortion),
        }
    }

    /// The camera of the frames: this one, or for an unsupported lens the undistorted camera that images are rectified to.
    pub(crate) fn camera(&self) -> Camera {
        let pinhole = Camera::pinhole(self.width, self.height, self.k);
        match self.lens {
            Lens::Brown(distortion) => Camera {
                distortion,
                ..pinhole
            },
            _ => pinhole,
        }
    }

    pub(crate) fn needs_rectifying(&self) -> bool {
        !matches!(self.lens, Lens::Brown(_))
    }

    /// The pixel of a point at (x, y, 1).
    pub(crate) fn project(&self, ray: Vec2) -> Vec2 {
        let [fx, fy, cx, cy] = self.k;
        let p = self.lens.distort(ray);
        Vec2::new(fx * p.x + cx, fy * p.y + cy)
    }

    pub(crate) fn ray(&self, px: Vec2) -> Vec2 {
        let [fx, fy, cx, cy] = self.k;
        self.lens
            .undistort(Vec2::new((px.x - cx) / fx, (px.y - cy) / fy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of an Azure Kinect's colour camera and of a fisheye camera.
    const RATIONAL: [f64; 8] = [0.5, -2.6, 0.0006, -0.0003, 1.5, 0.38, -2.4, 1.4];
    const FISHEYE: [f64; 4] = [-0.02, 0.01, -0.008, 0.002];

    #[test]
    fn every_lens_model_is_inverted() {
        for (model, d) in [
            ("plumb_bob", &[0.1, -0.2, 0.001, 0.002, 0.05][..]),
            ("rational_polynomial", &RATIONAL),
            ("equidistant", &FISHEYE),
            ("Inverse Brown Conrady", &[0.1, -0.2, 0.001, 0.002, 0.05]),
        ] {
            let lens = Lens::new(model, d).unwrap();
            for (x, y) in [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.4)] {
                let p = Vec2::new(x, y);
                let back = lens.undistort(lens.distort(p));
                assert!((back - p).norm() < 1e-9, "{model}: {p:?} {back:?}");
            }
        }
    }

    #[test]
    fn rectified_images_have_no_distortion() {
        let mut info = CameraInfo {
            distortion_model: "plumb_bob".into(),
            d: vec![0.1, -0.2, 0.0, 0.0, 0.0],
            k: [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0],
            ..CameraInfo::default()
        };
        let of = |info: &CameraInfo<'_>, rectified| {
            let optics = Optics::new(info, rectified).unwrap();
            (
                optics.k[0],
                optics.lens == Lens::Brown(BrownConrady::default()),
            )
        };
        assert_eq!(
            (of(&info, false), of(&info, true)),
            ((600.0, false), (600.0, true))
        );
        (info.p[0], info.p[5]) = (580.0, 580.0);
        assert_eq!(
            (of(&info, false), of(&info, true)),
            ((600.0, false), (580.0, true))
        );
    }

    #[test]
    fn lens_model_is_chosen_by_name_and_coefficients() {
        let none = Lens::Brown(BrownConrady::default());
        assert_eq!(Lens::new("equidistant", &[0.0; 4]), Ok(none));
        assert_eq!(Lens::new("anything", &[]), Ok(none));
        let as_brown = Lens::new(
            "rational_polynomial",
            &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        );
        assert!(matches!(as_brown, Ok(Lens::Brown(_))));
        assert!(Lens::new("ftheta", &[0.1]).is_err());
        assert!(Lens::new("plumb_bob", &[0.1, 0.0, 0.0, 0.0, 0.0, 0.2]).is_err());
        assert!(Lens::new("plumb_bob", &[f64::NAN]).is_err());
    }

    #[test]
    fn non_invertible_lenses_are_refused() {
        let of = |model: &str, d: &[f64]| {
            let optics = Optics {
                width: 160,
                height: 120,
                k: [150.0, 150.0, 79.5, 59.5],
                lens: Lens::new(model, d).unwrap(),
            };
            optics.check()
        };
        for (model, d) in [
            ("equidistant", &FISHEYE[..]),
            ("rational_polynomial", &RATIONAL),
            ("inverse_brown_conrady", &[0.1, -0.2, 0.001, 0.002, 0.05]),
        ] {
            assert_eq!(of(model, d), Ok(()), "{model}");
        }
        for (model, d) in [
            // Stretches nearly three times, folds, has a pole, folds the other way.
            ("equidistant", &[10.0, -20.0, 30.0, -40.0][..]),
            ("equidistant", &[-2.0, 0.0, 0.0, 0.0]),
            (
                "rational_polynomial",
                &[0.0, 0.0, 0.0, 0.0, 0.0, -4.0, 0.0, 0.0],
            ),
            ("inverse_brown_conrady", &[-3.0, 0.0, 0.0, 0.0, 0.0]),
        ] {
            let said = of(model, d).unwrap_err();
            assert!(
                said.expected.contains("can be inverted"),
                "{model}: {said:?}"
            );
            assert!(said.found.contains(&format!("{:?}", d[0])), "{said:?}");
        }
        // A fisheye with 180 degrees, of which the rectified image shows 127.
        let wide = Optics {
            width: 848,
            height: 800,
            k: [286.0, 286.0, 424.0, 400.0],
            lens: Lens::Equidistant([-0.008, 0.045, -0.042, 0.008]),
        };
        assert_eq!(wide.check(), Ok(()));
    }

    #[test]
    fn projection_matches_opencv() {
        // cv2.projectPoints([[0.3, -0.2, 1]]) and cv2.fisheye.projectPoints with K of 600, 600, 320, 240: OpenCV 5.0.
        let mut info = CameraInfo {
            width: 640,
            height: 480,
            k: [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0],
            ..CameraInfo::default()
        };
        for (model, d, expected) in [
            ("rational_polynomial", RATIONAL.to_vec(), RATIONAL_PX),
            ("equidistant", FISHEYE.to_vec(), FISHEYE_PX),
        ] {
            info.distortion_model = model.into();
            info.d = d;
            let px = Optics::new(&info, false)
                .unwrap()
                .project(Vec2::new(0.3, -0.2));
            assert!(
                (px - Vec2::new(expected[0], expected[1])).norm() < 1e-9,
                "{px:?}"
            );
        }
    }
    const RATIONAL_PX: [f64; 2] = [502.113_778_968_368_65, 118.622_014_021_087_52];
    const FISHEYE_PX: [f64; 2] = [492.365_793_175_595_97, 125.089_471_216_269_33];
}
