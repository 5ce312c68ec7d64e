//! Validation of configurations. Each stage checks its own fields with [`Checker`].

use stillpoint_geometry::Camera;

/// An invalid value in a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigProblem {
    /// Path, e.g. `tracking.min_inliers`.
    pub path: String,
    /// Expected and found value.
    pub message: String,
}

impl std::fmt::Display for ConfigProblem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.path, self.message)
    }
}

/// All problems of a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError(pub Vec<ConfigProblem>);

impl std::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the configuration is not valid:")?;
        self.0.iter().try_for_each(|p| write!(f, "\n  {p}"))
    }
}

impl std::error::Error for ConfigError {}

/// Maximum number of pixels of an image: the filter numbers its cells of 64 px in 16 bits, of which one number stands
/// for none. A cell has 8 px a side (`cells::CELL_PX`).
const MAX_PIXELS: u64 = 64 * (u16::MAX as u64 - 1);

/// Minimum side of an image, px: a corner needs its surroundings. Chosen: two cells of the filter, and wider than the
/// circle of 7 px by which a corner is found.
const MIN_SIDE: u32 = 16;

pub(crate) fn check_camera(camera: &Camera) -> Result<(), ConfigError> {
    let (width, height) = (camera.width, camera.height);
    // Sizes first: the other figures of a too large image are usually right.
    let problem = if u64::from(width) * u64::from(height) > MAX_PIXELS {
        format!(
            "expected an image of at most {MAX_PIXELS} px, found {width} x {height}: scale the images down"
        )
    } else if width.min(height) < MIN_SIDE {
        format!("expected an image of at least {MIN_SIDE} px per side, found {width} x {height}")
    } else if let Err(e) = camera.check() {
        e.to_string()
    } else {
        return Ok(());
    };
    Err(ConfigError(vec![ConfigProblem {
        path: "camera".to_owned(),
        message: problem,
    }]))
}

/// Collects range violations with their paths.
pub(crate) struct Checker<'a> {
    pub(crate) section: &'a str,
    pub(crate) problems: &'a mut Vec<ConfigProblem>,
}

impl Checker<'_> {
    /// Adds a problem unless `low <= value <= high` (false for NaN too).
    pub(crate) fn range(&mut self, name: &str, value: f64, low: f64, high: f64) {
        if !(low..=high).contains(&value) {
            self.problems.push(ConfigProblem {
                path: format!("{}.{name}", self.section),
                message: format!("expected {low} to {high}, found {value}"),
            });
        }
    }
}
