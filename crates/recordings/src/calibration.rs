//! Derives the camera of images of a given size from a camera info: binning and regions of interest, as in REP 104.

use crate::decode::Bad;
use crate::optics::{Optics, is_calibrated};
use stillpoint_ros_messages::CameraInfo;

#[derive(Debug, PartialEq)]
pub(crate) struct Calibration {
    pub(crate) optics: Optics,
    pub(crate) guesses: Vec<String>,
    pub(crate) warnings: Vec<String>,
}

/// The region of the sensor's image that was read out, and the binning.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Readout {
    corner: [u32; 2],
    size: [u32; 2],
    binning: [u32; 2],
    of: [u32; 2],
}

impl Readout {
    fn new(info: &CameraInfo<'_>) -> Self {
        let roi = &info.roi;
        // A region without a size extends to the image border.
        let side = |stated: u32, from: u32, all: u32| match stated {
            0 => all.saturating_sub(from),
            stated => stated,
        };
        Self {
            corner: [roi.x_offset, roi.y_offset],
            size: [
                side(roi.width, roi.x_offset, info.width),
                side(roi.height, roi.y_offset, info.height),
            ],
            binning: [info.binning_x.max(1), info.binning_y.max(1)],
            of: [info.width, info.height],
        }
    }

    /// Whether images of this size match the readout, with or without an incomplete bin at the border.
    fn gives(&self, size: [u32; 2]) -> bool {
        (0..2).all(|i| {
            let (side, binning) = (self.size[i], self.binning[i]);
            side / binning == size[i] || side.div_ceil(binning) == size[i]
        })
    }

    fn fits(&self) -> bool {
        (0..2).all(|i| u64::from(self.corner[i]) + u64::from(self.size[i]) <= u64::from(self.of[i]))
    }

    /// Camera of the readout, computed as by image_geometry.
    fn apply(&self, whole: &Optics) -> Optics {
        let [fx, fy, cx, cy] = whole.k;
        let [bx, by] = self.binning.map(f64::from);
        let [x, y] = self.corner.map(f64::from);
        Optics {
            k: [fx / bx, fy / by, (cx - x) / bx, (cy - y) / by],
            ..*whole
        }
    }
}

impl std::fmt::Display for Readout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([w, h], [x, y], [bx, by]) = (self.size, self.corner, self.binning);
        let region = self.size != self.of || self.corner != [0, 0];
        if region {
            write!(f, "a region of interest of {w} x {h} px at ({x}, {y})")?;
        }
        match [bx, by] {
            [1, 1] => Ok(()),
            _ if region => write!(f, " with binning {bx} x {by}"),
            _ => write!(f, "a binning of {bx} x {by}"),
        }
    }
}

/// Whether a camera info can describe images of this size.
pub(crate) fn fits(info: &CameraInfo<'_>, size: (u32, u32)) -> bool {
    let stated = (info.width, info.height);
    stated == size || stated == (0, 0) || Readout::new(info).gives([size.0, size.1])
}

/// The camera of images of this size. `rectified`: as in [`Optics::new`]; `name`: the info's name in messages.
///
/// # Errors
/// No calibration, one for another size, or impossible values.
pub(crate) fn of_images(
    info: &CameraInfo<'_>,
    rectified: bool,
    name: &str,
    size: (u32, u32),
) -> Result<Calibration, Bad> {
    let whole = Optics::new(info, rectified);
    let whole =
        whole.map_err(|found| Bad::new("a calibrated camera", format!("{name} with {found}")))?;
    let mut found = read_out(info, whole, name, size)?;
    if info.k[0] <= 0.0 && !rectified && is_calibrated(info) {
        let said = format!("{name} leaves K empty: the projection matrix P is used");
        found.guesses.push(said);
    }
    found.optics.check().map_err(|bad| {
        Bad::new(
            format!("a camera with {}", bad.expected),
            format!("{name} with {}", bad.found),
        )
    })?;
    Ok(found)
}

/// The camera of the region that was read out of the sensor's image.
fn read_out(
    info: &CameraInfo<'_>,
    whole: Optics,
    name: &str,
    (width, height): (u32, u32),
) -> Result<Calibration, Bad> {
    let (size, stated) = ([width, height], [info.width, info.height]);
    let of_size = |optics: Optics| Optics {
        width,
        height,
        ..optics
    };
    let mut found = Calibration {
        optics: of_size(whole),
        guesses: Vec::new(),
        warnings: Vec::new(),
    };
    let readout = Readout::new(info);
    let all = Readout {
        corner: [0, 0],
        size: stated,
        binning: [1, 1],
        of: stated,
    };
    if readout == all && (stated == size || stated == [0, 0]) {
        return Ok(found);
    }
    let [w, h] = stated;
    if !readout.gives(size) {
        if stated == size {
            found.warnings.push(format!(
                "{name} states {readout}, which does not give the images of {width} x {height} px: they have the size that it states without, and it is not applied"
            ));
            return Ok(found);
        }
        let mut expected = format!("images of {w} x {h} px, the size of {name}");
        if readout != all {
            expected += &format!(", or of {readout}");
        }
        return Err(Bad::new(expected, format!("{width} x {height} px")));
    }
    let applied = of_size(readout.apply(&whole));
    if readout.fits() || stated == [0, 0] {
        found.optics = applied;
        found
            .guesses
            .push(format!("{name} states {readout}, which is applied"));
        return Ok(found);
    }
    // By REP 104, K refers to the whole sensor. Drivers that state the region as the whole image may have moved the principal point too.
    let [_, _, cx, cy] = whole.k;
    let ends = if applied.check().is_ok() || found.optics.check().is_err() {
        found.optics = applied;
        let [_, _, x, y] = applied.k;
        format!(
            "K is taken as that of the whole sensor, and the principal point moves from ({cx:.1}, {cy:.1}) to ({x:.1}, {y:.1}) px"
        )
    } else {
        format!(
            "K is taken as that of the region, since the principal point ({cx:.1}, {cy:.1}) px would leave it"
        )
    };
    found.warnings.push(format!(
        "{name} states {readout}, which does not fit into the size that it states, {w} x {h} px: {ends}; a camera file says otherwise (--camera)"
    ));
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_ros_messages::RegionOfInterest;

    /// 640 x 480 px, with a region and a binning.
    fn info(region: [u32; 4], binning: u32) -> CameraInfo<'static> {
        let [x_offset, y_offset, width, height] = region;
        CameraInfo {
            width: 640,
            height: 480,
            distortion_model: "plumb_bob".into(),
            k: [520.0, 0.0, 320.0, 0.0, 522.0, 240.0, 0.0, 0.0, 1.0],
            binning_x: binning,
            binning_y: binning,
            roi: RegionOfInterest {
                x_offset,
                y_offset,
                width,
                height,
                ..RegionOfInterest::default()
            },
            ..CameraInfo::default()
        }
    }

    fn of(info: &CameraInfo<'_>, size: (u32, u32)) -> Result<Calibration, Bad> {
        of_images(info, false, "the info", size)
    }

    #[test]
    fn binning_and_regions_follow_rep_104() {
        let k = |info: &CameraInfo<'_>, size| of(info, size).map(|c| c.optics.k);
        assert_eq!(
            k(&info([0; 4], 0), (640, 480)),
            Ok([520.0, 522.0, 320.0, 240.0])
        );
        assert_eq!(
            k(&info([0; 4], 2), (320, 240)),
            Ok([260.0, 261.0, 160.0, 120.0])
        );
        let region = [80, 40, 480, 360];
        assert_eq!(
            k(&info(region, 1), (480, 360)),
            Ok([520.0, 522.0, 240.0, 200.0])
        );
        assert_eq!(
            k(&info(region, 2), (240, 180)),
            Ok([260.0, 261.0, 120.0, 100.0])
        );
        // A region without a size, and one not divisible by the binning.
        assert_eq!(
            k(&info([80, 40, 0, 0], 1), (560, 440)),
            Ok([520.0, 522.0, 240.0, 200.0])
        );
        assert!(k(&info([0, 0, 639, 479], 2), (319, 240)).is_ok());
        let said = of(&info(region, 2), (240, 180)).unwrap();
        assert!(
            said.warnings.is_empty() && said.guesses[0].contains("binning 2 x 2"),
            "{said:?}"
        );
    }

    #[test]
    fn mismatched_calibrations_are_reported_or_refused() {
        // Images of the whole size despite a binning.
        let whole = of(&info([0; 4], 2), (640, 480)).unwrap();
        assert_eq!(whole.optics.k[0], 520.0);
        assert!(
            whole.warnings[0].contains("a binning of 2 x 2")
                && whole.warnings[0].contains("not applied"),
            "{whole:?}"
        );
        // A region larger than the image.
        let mut cropped = info([80, 40, 240, 200], 1);
        (cropped.width, cropped.height) = (240, 200);
        cropped.k[2] = 180.0;
        cropped.k[5] = 130.0;
        let applied = of(&cropped, (240, 200)).unwrap();
        assert_eq!(applied.optics.k[2..], [100.0, 90.0]);
        let said = &applied.warnings[0];
        assert!(
            said.contains("240 x 200 px at (80, 40)") && said.contains("does not fit"),
            "{said}"
        );
        // K already refers to the region.
        cropped.k[2] = 90.0;
        cropped.k[5] = 50.0;
        let kept = of(&cropped, (240, 200)).unwrap();
        assert_eq!(kept.optics.k[2..], [90.0, 50.0]);
        // An unrelated size.
        let refused = of(&info([80, 40, 480, 360], 1), (320, 240)).unwrap_err();
        for part in ["640 x 480 px", "480 x 360 px at (80, 40)"] {
            assert!(refused.expected.contains(part), "{refused:?}");
        }
        assert_eq!(refused.found, "320 x 240 px");
    }

    #[test]
    fn empty_camera_matrix_is_taken_from_the_projection() {
        let mut empty = info([0; 4], 0);
        (empty.p[0], empty.p[5], empty.p[2], empty.p[6]) = (510.0, 511.0, 318.0, 241.0);
        let own = of(&empty, (640, 480)).unwrap();
        assert!(own.optics.k[0] == 520.0 && own.guesses.is_empty());
        empty.k = [0.0; 9];
        let projected = of(&empty, (640, 480)).unwrap();
        assert_eq!(projected.optics.k, [510.0, 511.0, 318.0, 241.0]);
        assert!(projected.guesses[0].contains("leaves K empty"));
        empty.p = [0.0; 12];
        let refused = of(&empty, (640, 480)).unwrap_err();
        assert!(refused.found.contains("fx = 0.0"), "{refused:?}");
    }

    #[test]
    fn invalid_calibrations_are_reported_with_valid_ranges() {
        let mut bad = info([0; 4], 0);
        bad.k[2] = 0.0;
        let refused = of(&bad, (640, 480)).unwrap_err();
        assert!(refused.found == "the info with cx = 0.0", "{refused:?}");
        assert!(
            refused.expected.contains("cx from 64 to 575 px"),
            "{refused:?}"
        );
    }
}
