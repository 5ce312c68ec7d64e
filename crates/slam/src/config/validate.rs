//! Validation of a configuration.

use super::Config;
use crate::validation::{Checker, ConfigError};

impl Config {
    /// Checks the range of every field and reports all problems at once.
    ///
    /// # Errors
    /// [`ConfigError`] with one entry per field out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let mut problems = Vec::new();
        let mut section = |section: &'static str, f: &dyn Fn(&mut Checker<'_>)| {
            f(&mut Checker {
                section,
                problems: &mut problems,
            });
        };
        section("features", &|c| {
            let f = &self.features;
            c.range("features", f.features as f64, 100.0, 10_000.0);
            c.range("fast_threshold", f64::from(f.fast_threshold), 1.0, 254.0);
        });
        section("sensor", &|c| self.sensor.check(c));
        section("static_filter", &|c| self.static_filter.check(c));
        section("tracking", &|c| self.tracking.check(c));
        section("keyframes", &|c| self.keyframes.check(c));
        section("mapping", &|c| self.mapping.check(c));
        section("looping", &|c| self.looping.check(c));
        section("detector", &|c| {
            c.range("stride", f64::from(self.detector.stride), 1.0, 100.0);
        });
        section("schedule", &|c| {
            c.range("detector", f64::from(self.schedule.detector), 0.0, 1000.0);
            c.range("mapper", f64::from(self.schedule.mapper), 0.0, 1000.0);
            c.range(
                "loop_closer",
                f64::from(self.schedule.loop_closer),
                0.0,
                1000.0,
            );
        });
        if problems.is_empty() {
            Ok(())
        } else {
            Err(ConfigError(problems))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detector_stride_is_limited_to_1_to_100() {
        for (stride, valid) in [(0, false), (1, true), (100, true), (101, false)] {
            let mut config = Config::default();
            config.detector.stride = stride;
            let problems = config.validate().err().map(|e| e.to_string());
            assert_eq!(problems.is_none(), valid, "{stride}");
            assert!(problems.is_none_or(|p| p.contains("detector.stride: expected 1 to 100")));
        }
    }
}
