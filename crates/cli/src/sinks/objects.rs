//! `--objects`: writes the objects of each frame as a table.

use crate::failure::Failure;
use crate::output::StreamedFile;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use clap::Args;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint::detection::{Motion, Object, ObjectState};
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::{Event, FrameReport};

/// The columns before the covariance: colour stamp, s; id and class of the object; score, track state and motion state; box in raw pixels;
/// position, m, and velocity, m/s, in the world of the online trajectory.
const HEADER: &str = "timestamp,id,class,score,state,motion,x0,y0,x1,y1,px,py,pz,vx,vy,vz";
const NAMES: [&str; 6] = ["px", "py", "pz", "vx", "vy", "vz"];

const OPTION: &str = "--objects";

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ObjectsOutput {
    /// Write the objects of every frame: id, class, state, motion (moving, parked, unknown), box (raw pixels), position (m), velocity (m/s)
    /// and their covariance, in the world of trajectory_online.txt; unknown values are left empty.
    #[arg(long, value_name = "FILE.csv", verbatim_doc_comment)]
    pub(crate) objects: Option<PathBuf>,
}

impl Output for ObjectsOutput {
    fn begin(&self, _: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(path) = &self.objects else {
            return Ok(None);
        };
        Ok(Some(Box::new(ObjectFile::create(path)?)))
    }

    fn files(&self) -> Vec<(&'static str, &Path)> {
        self.objects.iter().map(|f| (OPTION, &**f)).collect()
    }
}

#[derive(Debug)]
struct ObjectFile {
    file: StreamedFile,
    path: PathBuf,
    rows: usize,
}

impl Sink for ObjectFile {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_all("objects"))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(frame) = event.as_frame() else {
            return Ok(());
        };
        let _span = tracing::info_span!("objects").entered();
        self.add(&frame.report)
    }

    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        let said = format!("{} rows of objects in {}\n", self.rows, self.path.display());
        self.file.finish()?;
        ended.found.said += &said;
        Ok(())
    }
}

impl ObjectFile {
    fn create(path: &Path) -> Result<Self, Failure> {
        let mut file = StreamedFile::create(path, OPTION)?;
        file.write(|w| writeln!(w, "{}", header()))?;
        Ok(Self {
            file,
            path: path.to_owned(),
            rows: 0,
        })
    }

    /// One row per object of a frame that is not tentative.
    fn add(&mut self, report: &FrameReport) -> Result<(), Failure> {
        let objects = report.objects.iter();
        let sure: Vec<&Object> = objects
            .filter(|o| o.state != ObjectState::Tentative)
            .collect();
        self.rows += sure.len();
        self.file.write(|w| {
            let mut rows = sure.into_iter();
            rows.try_for_each(|o| writeln!(w, "{}", row(report.stamp, o)))
        })
    }
}

/// The upper triangle of the covariance, row by row.
fn triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|i| (i..6).map(move |j| (i, j)))
}

fn header() -> String {
    let covariance = triangle().map(|(i, j)| format!(",cov_{}_{}", NAMES[i], NAMES[j]));
    HEADER.to_owned() + &covariance.collect::<String>()
}

fn row(stamp: f64, object: &Object) -> String {
    let state = match object.state {
        ObjectState::Tentative => "tentative",
        ObjectState::Confirmed => "confirmed",
        ObjectState::Coasting => "coasting",
        ObjectState::Hidden => "hidden",
    };
    let motion = match object.motion {
        Motion::Unknown => "unknown",
        Motion::Moving => "moving",
        Motion::Parked => "parked",
    };
    let b = &object.bounds;
    let mut row = format!(
        "{stamp:.6},{},{},{:.3},{state},{motion},{:.2},{:.2},{:.2},{:.2}",
        object.id.0, object.class, object.score, b.x0, b.y0, b.x1, b.y1
    );
    // Unknown values are left empty.
    for vector in [object.position, object.velocity] {
        for i in 0..3 {
            row += &vector.map_or_else(|| ",".to_owned(), |v| format!(",{:.4}", v[i]));
        }
    }
    for (i, j) in triangle() {
        row += &object
            .covariance
            .map_or_else(|| ",".to_owned(), |c| format!(",{:.4e}", c[(i, j)]));
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::detection::{BoundingBox, ClassId, ObjectId};
    use stillpoint::geometry::{Mat6, Vec3};

    #[test]
    fn object_rows_match_the_header() {
        let known = Object {
            id: ObjectId(4),
            class: ClassId::from_name("dining table").unwrap(),
            score: 0.5,
            state: ObjectState::Coasting,
            bounds: BoundingBox::default(),
            bounds_sigma: [0.0; 2],
            depth_range: None,
            position: Some(Vec3::new(1.0, 2.0, 3.0)),
            velocity: Some(Vec3::new(0.1, 0.0, -0.25)),
            covariance: Some(Mat6::identity() * 0.01),
            size: None,
            last_seen: 0.0,
            motion: Motion::Parked,
        };
        let unknown = Object {
            position: None,
            velocity: None,
            covariance: None,
            ..known.clone()
        };
        let columns = header().split(',').count();
        assert_eq!(columns, 16 + 21);
        for object in [&known, &unknown] {
            assert_eq!(row(1.5, object).split(',').count(), columns);
        }
        let row = row(1.5, &known);
        assert!(
            row.starts_with("1.500000,4,dining table,0.500,coasting,parked,"),
            "{row}"
        );
        assert!(
            row.contains(",1.0000,2.0000,3.0000,0.1000,0.0000,-0.2500,1.0000e-2,"),
            "{row}"
        );
    }
}
