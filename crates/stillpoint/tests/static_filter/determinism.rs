//! The same frames and detections give the same bytes on any processor.

use super::world::{Recording, Run, with};
use stillpoint_imaging::Simd;
use stillpoint_slam::{Preset, System};

/// All bits of a run's verdicts, objects and poses.
fn bytes(run: &Run) -> Vec<u64> {
    let mut out = Vec::new();
    for report in &run.reports {
        for v in report.verdicts.iter() {
            out.extend(v.pixel.map(|x| u64::from(x.to_bits())));
            out.push(u64::from(v.dynamic) << 32 | u64::from(v.risk.to_bits()));
        }
        for o in report.objects.iter() {
            let b = o.bounds;
            out.push(u64::from(o.id.0));
            out.extend([b.x0, b.y0, b.x1, b.y1].map(f64::to_bits));
        }
    }
    for pose in run.poses() {
        let t = pose.world_from_camera.translation;
        out.extend([t.x, t.y, t.z].map(f64::to_bits));
        let r = pose.world_from_camera.rotation_matrix();
        out.extend(r.iter().map(|x| x.to_bits()));
    }
    out
}

#[test]
fn results_are_identical_twice_and_without_simd() {
    let recording = Recording::simulated("walking_rpy", 40..75, 0.3);
    let run = |simd, preset, delay| {
        let mut config = with(preset);
        config.schedule.detector = delay;
        let system = System::new(config, recording.camera, simd).unwrap();
        recording.drive(system.with_detector(Box::new(recording.detector())))
    };
    let cases = [
        (Preset::Default, 0),
        (Preset::Default, 3),
        (Preset::Paper, 0),
    ];
    let runs = cases.map(|(preset, delay)| {
        let first = run(Simd::detect(), preset, delay);
        // The runs are not trivial: people are rejected.
        let rejected = first.reports.iter().map(|r| r.counts.dynamic).sum::<u32>();
        assert!(rejected > 500, "{preset:?}: {rejected}");
        let first = bytes(&first);
        assert!(first == bytes(&run(Simd::detect(), preset, delay)));
        assert!(first == bytes(&run(Simd::Scalar, preset, delay)));
        first
    });
    // Control: late detections change the run.
    let [now, late, _] = runs;
    assert!(now != late);
}
