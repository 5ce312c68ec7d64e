//! What was found, as values: for the screen, for JSON, and for tests.

use serde::Serialize;

/// What can be wrong with a stream, the most harmful first: the order of a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Symptom {
    /// Frames cannot be read.
    Unreadable,
    /// The lens model cannot be inverted, or the camera's figures are none.
    Lens,
    /// Depth is too large or too small by a factor.
    DepthScale,
    /// Colour and depth are mirror images of each other, or turned by half a turn.
    Mirrored,
    /// Depth is not in the pixels of the colour image.
    Registration,
    /// The focal length is wrong.
    FocalLength,
    /// The depth image or the colour image stands still while the other goes on.
    Standstill,
    /// Colour and depth were taken at other times than their stamps say.
    Synchronisation,
    /// Stamps run backwards, stand still or jump.
    Stamps,
    /// The inertial sensor has other axes, units or stamps than stated.
    InertialSensor,
    /// Odometry of the base that carries the camera stands still, jumps, or has another mount or other stamps than stated.
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

/// A number that was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// What it is.
    pub name: &'static str,
    /// The number.
    pub value: f64,
    /// Its standard deviation, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f64>,
    /// Its unit; empty for shares and ratios.
    pub unit: &'static str,
}

impl Figure {
    /// A number without a standard deviation.
    pub(crate) fn new(name: &'static str, value: f64, unit: &'static str) -> Self {
        Self {
            name,
            value,
            sigma: None,
            unit,
        }
    }

    /// The same with a standard deviation.
    pub(crate) fn with_sigma(self, sigma: f64) -> Self {
        Self {
            sigma: Some(sigma),
            ..self
        }
    }
}

impl std::fmt::Display for Figure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Three digits that mean something, without exponents.
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

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What it is.
    pub symptom: Symptom,
    /// What is wrong, in a sentence.
    pub message: String,
    /// What to do or to type.
    pub remedy: String,
    /// What that rests on.
    pub evidence: Vec<Figure>,
}

/// What a stream is like.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Frames looked at.
    pub frames: usize,
    /// Time between the first and the last of them, s.
    pub seconds: f64,
    /// What is wrong, the most harmful first.
    pub findings: Vec<Finding>,
    /// What was measured, whether something is wrong with it or not.
    pub measured: Vec<Figure>,
    /// What could not be judged, and why, one sentence each.
    pub not_judged: Vec<String>,
}

impl Report {
    /// Whether something of this kind is wrong.
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
