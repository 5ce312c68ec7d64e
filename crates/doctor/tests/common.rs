//! Streams in memory, and the doctor's findings with and without faults.

use std::collections::VecDeque;
use stillpoint_datasets::{Disturbance, Disturbed, Fault, Faulty};
use stillpoint_doctor::{Report, Setup, Symptom, examine};
use stillpoint_geometry::Camera;
use stillpoint_imaging::{FrameSource, RgbdFrame, SourceError};

pub(crate) const SECONDS: f64 = 3.0;

pub(crate) struct Stream {
    pub(crate) name: String,
    pub(crate) frames: Vec<RgbdFrame>,
    pub(crate) setup: Setup,
}

pub(crate) struct Played(VecDeque<RgbdFrame>);

impl FrameSource for Played {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        self.0.pop_front().map(Ok)
    }
}

impl Stream {
    fn played(&self) -> Played {
        Played(self.frames.iter().cloned().collect())
    }

    pub(crate) fn report(&self) -> Report {
        self.look(&mut self.played(), self.setup, "as it is")
    }

    pub(crate) fn with(&self, fault: Fault) -> Report {
        let mut faulty = Faulty::new(self.played(), fault);
        self.look(&mut faulty, self.setup, &format!("{fault:?}"))
    }

    pub(crate) fn disturbed(&self, what: Disturbance) -> Report {
        let all = vec![(0..u32::MAX, what)];
        let mut disturbed = Disturbed::new(self.played(), all).unwrap();
        self.look(&mut disturbed, self.setup, &format!("{what:?}"))
    }

    pub(crate) fn taken_for(&self, camera: Camera) -> Report {
        let setup = Setup {
            camera,
            ..self.setup
        };
        let what = format!("fx {:.1} fy {:.1}", camera.fx, camera.fy);
        self.look(&mut self.played(), setup, &what)
    }

    fn look(&self, source: &mut dyn FrameSource, setup: Setup, what: &str) -> Report {
        let report = examine(source, setup, SECONDS).unwrap();
        println!("== {} {what}\n{report}", self.name);
        report
    }

    /// The fault must be the first finding. Its consequences may follow.
    pub(crate) fn check(&self, report: &Report, symptom: Symptom) {
        let first = report.findings.first().map(|f| f.symptom);
        assert_eq!(first, Some(symptom), "{}\n{report}", self.name);
    }

    /// The four faults that must be found.
    pub(crate) fn check_faults(&self) {
        let camera = self.setup.camera;
        for factor in [5.0, 0.2] {
            let report = self.with(Fault::DepthScale(factor));
            self.check(&report, Symptom::DepthScale);
        }
        // The cameras of a Kinect: the infrared camera 25 mm aside, of 580 px.
        let depth = Camera {
            width: camera.width,
            height: camera.height,
            ..Camera::pinhole(0, 0, [580.0, 580.0, 314.0, 252.0])
        };
        let report = self.with(Fault::Unregistered {
            colour: camera,
            depth,
            baseline: 0.025,
        });
        self.check(&report, Symptom::Registration);
        for late in [0.04, -0.04] {
            let report = self.with(Fault::DepthLate(late));
            self.check(&report, Symptom::Synchronisation);
        }
        let wrong = Camera {
            fx: 1.1 * camera.fx,
            ..camera
        };
        self.check(&self.taken_for(wrong), Symptom::FocalLength);
    }
}

pub(crate) fn assert_well(name: &str, report: &Report) {
    assert!(report.findings.is_empty(), "{name}\n{report}");
}
