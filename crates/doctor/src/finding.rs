//! Findings as values: for the screen, for JSON, and for tests.

use serde::Serialize;

/// Kinds of faults in a stream, the most harmful first; reports use this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Symptom {
    /// Frames cannot be read.
    Unreadable,
    /// The lens model cannot be inverted, or the intrinsics are invalid.
    Lens,
    /// Depth is too large or too small by a factor.
    DepthScale,
    /// Colour and depth are mirrored or rotated by 180 degrees against each other.
    Mirrored,
    /// Depth is not registered to the colour image.
    Registration,
    /// The focal length is wrong.
    FocalLength,
    /// The depth image or the colour image is frozen while the other continues.
    Standstill,
    /// Exposure times of colour and depth differ from their stamps.
    Synchronisation,
    /// Stamps decrease, repeat or jump.
    Stamps,
    /// The inertial sensor has other axes, units or stamps than stated.
    InertialSensor,
    /// Odometry of the camera's base is constant, jumps, or has another mount or other stamps than stated.
    Odometry,
    /// Images are too dark or too bright.
    Exposure,
    /// Images are blurred.
    Blur,
    /// Much of the depth is missing.
    DepthHoles,
    /// Frames are missing.
    DroppedFrames,
}

/// A measured value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Name.
    pub name: &'static str,
    /// Value.
    pub value: f64,
    /// Standard deviation, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f64>,
    /// Unit; empty for fractions and ratios.
    pub unit: &'static str,
}

impl Figure {
    pub(crate) fn new(name: &'static str, value: f64, unit: &'static str) -> Self {
        Self {
            name,
            value,
            sigma: None,
            unit,
        }
    }

    pub(crate) fn with_sigma(self, sigma: f64) -> Self {
        Self {
            sigma: Some(sigma),
            ..self
        }
    }
}

impl std::fmt::Display for Figure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Three significant digits, without exponents.
        let size = self.value.abs().max(self.sigma.unwrap_or(0.0));
        let decimals = match size {
            s if s >= 100.0 => 0,
            s if s >= 10.0 => 1,
            s if s >= 0.1 => 2,
            _ => 4,
        };
        write!(f, "{}: {:.decimals$}", self.name, self.value)?;
        if let Some(sigma) = self.sigma {
            write!(f, " +- {sigma:.decimals$}")?;
        }
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        Ok(())
    }
}

/// One fault.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Its kind.
    pub symptom: Symptom,
    /// The fault, in a sentence.
    pub message: String,
    /// The remedy or command.
    pub remedy: String,
    /// The evidence.
    pub evidence: Vec<Figure>,
}

/// Result of an examination.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Number of examined frames.
    pub frames: usize,
    /// Time between the first and the last of them, s.
    pub seconds: f64,
    /// The faults, the most harmful first.
    pub findings: Vec<Finding>,
    /// All measured values, with or without a fault.
    pub measured: Vec<Figure>,
    /// Checks that were not possible, with the reason, one sentence each.
    pub not_judged: Vec<String>,
}

impl Report {
    /// Whether there is a finding of this kind.
    #[must_use]
    pub fn names(&self, symptom: Symptom) -> bool {
        self.findings.iter().any(|f| f.symptom == symptom)
    }

    pub(crate) fn find(&mut self, finding: Finding) {
        self.findings.push(finding);
    }

    pub(crate) fn measure(&mut self, figure: Figure) {
        self.measured.push(figure);
    }

    pub(crate) fn pass_over(&mut self, why: impl Into<String>) {
        self.not_judged.push(why.into());
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{} frames, {:.1} s: {}",
            self.frames,
            self.seconds,
            match self.findings.len() {
                0 => "nothing wrong was found".to_owned(),
                1 => "one thing is wrong".to_owned(),
                n => format!("{n} things are wrong, the most harmful first"),
            }
        )?;
        for (i, finding) in self.findings.iter().enumerate() {
            writeln!(f, "{}. {}", i + 1, finding.message)?;
            writeln!(f, "   -> {}", finding.remedy)?;
            for figure in &finding.evidence {
                writeln!(f, "      {figure}")?;
            }
        }
        if !self.measured.is_empty() {
            writeln!(f, "measured:")?;
            for figure in &self.measured {
                writeln!(f, "  {figure}")?;
            }
        }
        if !self.not_judged.is_empty() {
            writeln!(f, "not judged:")?;
            for line in &self.not_judged {
                writeln!(f, "  {line}")?;
            }
        }
        Ok(())
    }
}
