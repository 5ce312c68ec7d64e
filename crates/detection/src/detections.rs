//! Detections in one image.

use stillpoint_imaging::FrameId;

/// Number of a class among the 80 of COCO, in the usual order of detectors: 0 is a person.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClassId(pub u8);

impl ClassId {
    /// A person.
    pub const PERSON: Self = Self(0);
}

/// An upright box in the raw (distorted) image, px: the pixel centred at (0, 0) extends from -0.5 to 0.5.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundingBox {
    /// Left.
    pub x0: f64,
    /// Top.
    pub y0: f64,
    /// Right.
    pub x1: f64,
    /// Bottom.
    pub y1: f64,
}

impl BoundingBox {
    /// Width, px; not negative.
    #[must_use]
    pub fn width(&self) -> f64 {
        (self.x1 - self.x0).max(0.0)
    }

    /// Height, px; not negative.
    #[must_use]
    pub fn height(&self) -> f64 {
        (self.y1 - self.y0).max(0.0)
    }

    /// Area, px^2.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.width() * self.height()
    }

    /// Centre, px.
    #[must_use]
    pub fn centre(&self) -> [f64; 2] {
        [(self.x0 + self.x1) / 2.0, (self.y0 + self.y1) / 2.0]
    }

    /// Whether a pixel lies in the box.
    #[must_use]
    pub fn contains(&self, u: f64, v: f64) -> bool {
        self.x0 <= u && u <= self.x1 && self.y0 <= v && v <= self.y1
    }

    /// Intersection over union with another box, 0 to 1.
    #[must_use]
    pub fn iou(&self, other: &Self) -> f64 {
        let common = Self {
            x0: self.x0.max(other.x0),
            y0: self.y0.max(other.y0),
            x1: self.x1.min(other.x1),
            y1: self.y1.min(other.y1),
        }
        .area();
        let union = self.area() + other.area() - common;
        if union > 0.0 { common / union } else { 0.0 }
    }

    /// The part inside an image of this size.
    #[must_use]
    pub fn clipped(&self, width: usize, height: usize) -> Self {
        let (w, h) = (width as f64 - 0.5, height as f64 - 0.5);
        Self {
            x0: self.x0.clamp(-0.5, w),
            y0: self.y0.clamp(-0.5, h),
            x1: self.x1.clamp(-0.5, w),
            y1: self.y1.clamp(-0.5, h),
        }
    }
}

/// A detected object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Class.
    pub class: ClassId,
    /// Confidence of the detector, 0 to 1.
    pub score: f32,
    /// Bounding box.
    pub bounds: BoundingBox,
}

/// All detections in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Detections {
    /// The frame.
    pub frame: FrameId,
    /// Its colour stamp, s.
    pub stamp: f64,
    /// Detections, best score first.
    pub items: Vec<Detection>,
}
