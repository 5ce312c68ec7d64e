//! What is wrong with a configuration, and where. Each stage checks its own fields by [`Checker`].

/// One thing that is wrong with a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigProblem {
    /// Where, e.g. `tracking.min_inliers`.
    pub path: String,
    /// What was expected and found.
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

/// Collects range violations with their paths.
pub(crate) struct Checker<'a> {
    pub(crate) section: &'a str,
    pub(crate) problems: &'a mut Vec<ConfigProblem>,
}

impl Checker<'_> {
    /// Notes a problem unless `low <= value <= high` (false for NaN too).
    pub(crate) fn range(&mut self, name: &str, value: f64, low: f64, high: f64) {
        if !(low..=high).contains(&value) {
            self.problems.push(ConfigProblem {
                path: format!("{}.{name}", self.section),
                message: format!("expected {low} to {high}, found {value}"),
            });
        }
    }
}
