//! Plausibility checks of camera intrinsics and distortion, shared by all camera readers.

use crate::{BrownConrady, Camera, Vec2};

/// Maximum image side, px.
const MAX_SIDE: u32 = 1 << 15;
/// Maximum focal length and principal point, px.
const MAX_PX: f64 = 1e7;
/// Minimum focal length, px.
const MIN_FOCAL: f64 = 1.0;
/// Maximum factor between fx and fy. Pixels of depth cameras are square; the flattest in use elsewhere are those of one field
/// of an interlaced image, twice as high as wide.
const MAX_ASPECT: f64 = 2.0;
/// Minimum ratio of focal length to image side: 152 degrees along it. Rectilinear lenses end at 130 degrees (0.23); a
/// fisheye of 220 degrees whose circle is as high as an image of 16:9 has 0.146 of the width.
const MIN_FOCAL_SHARE: f64 = 0.125;
/// Maximum ratio of focal length to the longer side: 5.7 degrees. Depth cameras for small parts see 15 degrees and
/// more; below 6, rotation and translation cannot be distinguished.
const MAX_FOCAL_SHARE: f64 = 10.0;
/// Minimum distance of the principal point from a border, as a share of the side. For a whole sensor it is within some
/// per cent of the middle; for an image cropped to half its sides, at a quarter or more; a driver that omits it
/// reports 0.
const MIN_MARGIN: f64 = 0.1;
/// Grid samples along each image side at which the distortion is tested.
const SAMPLES: u32 = 32;
/// Samples on the segment from the optical axis to each grid sample.
const STEPS: u32 = 16;
/// Maximum round-trip error of undistorting and distorting a raw pixel, px: far below corner localisation errors, far
/// above the residual of Newton's method where it converges.
const MAX_ERROR: f64 = 1e-3;

/// Reason why a camera is rejected.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum CameraError {
    /// The image is empty or implausibly large.
    Size {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
    },
    /// Focal lengths or principal point are not plausible pixel values.
    Intrinsics {
        /// fx, fy, cx, cy, px.
        found: [f64; 4],
    },
    /// fx and fy differ too much.
    Aspect {
        /// fx and fy, px.
        found: [f64; 2],
    },
    /// The field of view is implausible.
    FieldOfView {
        /// `fx` or `fy`.
        figure: &'static str,
        /// Value found, px.
        found: f64,
        /// Plausible range, px.
        plausible: [f64; 2],
        /// Width and height, px.
        size: [u32; 2],
    },
    /// The principal point is at a border of the image or outside.
    PrincipalPoint {
        /// `cx` or `cy`.
        figure: &'static str,
        /// Value found, px.
        found: f64,
        /// Plausible range, px.
        plausible: [f64; 2],
        /// Width and height, px.
        size: [u32; 2],
    },
    /// A distortion coefficient is not finite.
    Coefficients {
        /// The coefficients.
        found: BrownConrady,
    },
    /// The distortion cannot be inverted within the image: two rays share a pixel, or a pixel has none.
    Fold {
        /// The coefficients.
        found: BrownConrady,
        /// The first raw pixel found without a correct inverse.
        pixel: [f64; 2],
    },
}

impl CameraError {
    /// The expected values, as text.
    #[must_use]
    pub fn expected(&self) -> String {
        match self {
            Self::Size { .. } => format!("an image of 1 to {MAX_SIDE} px per side"),
            Self::Intrinsics { .. } => format!(
                "focal lengths fx and fy from {MIN_FOCAL} px on and a principal point cx cy, all up to {MAX_PX} px"
            ),
            Self::Aspect { .. } => {
                format!("focal lengths fx and fy within a factor of {MAX_ASPECT}")
            }
            Self::FieldOfView {
                figure,
                plausible: [low, high],
                size: [width, height],
                ..
            } => format!(
                "a focal length {figure} of {low:.0} to {high:.0} px, in an image of {width} x {height} px"
            ),
            Self::PrincipalPoint {
                figure,
                plausible: [low, high],
                size: [width, height],
                ..
            } => format!(
                "a principal point {figure} from {low:.0} to {high:.0} px, in an image of {width} x {height} px"
            ),
            Self::Coefficients { .. } => "finite distortion coefficients".to_owned(),
            Self::Fold { .. } => "a lens model that can be inverted within the image".to_owned(),
        }
    }

    /// The values found, as text, with a hint at the cause.
    #[must_use]
    pub fn found(&self) -> String {
        match self {
            Self::Size { width, height } => format!("{width} x {height}"),
            Self::Intrinsics {
                found: [fx, fy, cx, cy],
            } => format!("fx = {fx:?}, fy = {fy:?}, cx = {cx:?}, cy = {cy:?}"),
            Self::Aspect { found: [fx, fy] } => format!("fx = {fx:?}, fy = {fy:?}"),
            Self::FieldOfView { figure, found, .. }
            | Self::PrincipalPoint { figure, found, .. } => format!("{figure} = {found:?}"),
            Self::Coefficients { found } => coefficients(found),
            Self::Fold {
                found,
                pixel: [u, v],
            } => {
                let hint = if found.k3 == 0.0 && (found.k1 != 0.0 || found.k2 != 0.0) {
                    "k3 is 0: was it left out?"
                } else {
                    "are they in this order, of this model, and of this image size?"
                };
                format!(
                    "one that cannot at pixel ({u:.0}, {v:.0}), {}; {hint}",
                    coefficients(found)
                )
            }
        }
    }
}

fn coefficients(d: &BrownConrady) -> String {
    let BrownConrady { k1, k2, p1, p2, k3 } = d;
    format!("k1 = {k1:?}, k2 = {k2:?}, p1 = {p1:?}, p2 = {p2:?}, k3 = {k3:?}")
}

impl std::fmt::Display for CameraError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "expected {}, found {}", self.expected(), self.found())
    }
}

impl std::error::Error for CameraError {}

impl Camera {
    /// Checks that intrinsics are plausible and that the distortion is one to one within the image: each raw pixel has
    /// one ray, and pixels nearer to the axis have rays nearer to it. Takes about as long as undistorting some
    /// thousands of points.
    ///
    /// # Errors
    /// [`CameraError`] for the first problem found.
    pub fn check(&self) -> Result<(), CameraError> {
        self.check_figures()?;
        self.check_view()?;
        if self.distortion.is_zero() {
            return Ok(());
        }
        let (w, h) = (f64::from(self.width) - 1.0, f64::from(self.height) - 1.0);
        // Distortions fold from the outside inwards: the first sample, a corner, detects most of them.
        for j in 0..=SAMPLES {
            for i in 0..=SAMPLES {
                let share = |k: u32| f64::from(k) / f64::from(SAMPLES);
                let raw = Vec2::new(share(i) * w, share(j) * h);
                if !self.inverts_at(raw) {
                    return Err(CameraError::Fold {
                        found: self.distortion,
                        pixel: [raw.x, raw.y],
                    });
                }
            }
        }
        Ok(())
    }

    /// The part of [`Self::check`] that does not depend on the image size.
    ///
    /// # Errors
    /// [`CameraError`] for the first problem found.
    pub fn check_figures(&self) -> Result<(), CameraError> {
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&self.width) || !sides.contains(&self.height) {
            return Err(CameraError::Size {
                width: self.width,
                height: self.height,
            });
        }
        let Self { fx, fy, cx, cy, .. } = *self;
        let focal = |f: f64| (MIN_FOCAL..=MAX_PX).contains(&f);
        if !(focal(fx) && focal(fy) && cx.abs() <= MAX_PX && cy.abs() <= MAX_PX) {
            return Err(CameraError::Intrinsics {
                found: [fx, fy, cx, cy],
            });
        }
        if fx.max(fy) > MAX_ASPECT * fx.min(fy) {
            return Err(CameraError::Aspect { found: [fx, fy] });
        }
        let BrownConrady { k1, k2, p1, p2, k3 } = self.distortion;
        if ![k1, k2, p1, p2, k3].iter().all(|k| k.is_finite()) {
            return Err(CameraError::Coefficients {
                found: self.distortion,
            });
        }
        Ok(())
    }

    fn check_view(&self) -> Result<(), CameraError> {
        let size = [self.width, self.height];
        let longer = f64::from(self.width.max(self.height));
        for (figure, found, side) in [("fx", self.fx, self.width), ("fy", self.fy, self.height)] {
            let plausible = [MIN_FOCAL_SHARE * f64::from(side), MAX_FOCAL_SHARE * longer];
            if !(plausible[0]..=plausible[1]).contains(&found) {
                return Err(CameraError::FieldOfView {
                    figure,
                    found,
                    plausible,
                    size,
                });
            }
        }
        for (figure, found, side) in [("cx", self.cx, self.width), ("cy", self.cy, self.height)] {
            let last = f64::from(side) - 1.0;
            let plausible = [MIN_MARGIN * last, (1.0 - MIN_MARGIN) * last];
            if !(plausible[0]..=plausible[1]).contains(&found) {
                return Err(CameraError::PrincipalPoint {
                    figure,
                    found,
                    plausible,
                    size,
                });
            }
        }
        Ok(())
    }

    /// Whether undistorting a raw pixel yields the correct ray. A model that folds has several inverses; the correct
    /// one can be reached from the axis without crossing a fold, where the determinant of the derivative becomes 0.
    fn inverts_at(&self, raw: Vec2) -> bool {
        let flat = self.undistort(raw);
        let error = (self.distort(flat) - raw).norm();
        // Also false for NaN.
        let returns = error <= MAX_ERROR;
        let ray = self.ray(flat);
        returns
            && (0..=STEPS).all(|k| {
                let q = Vec2::new(ray.x, ray.y) * (f64::from(k) / f64::from(STEPS));
                let [a, b, d] = self.distortion.derivative(q);
                // A point reflection has a positive determinant as well.
                a * d - b * b > 0.0 && a + d > 0.0
            })
    }
}
