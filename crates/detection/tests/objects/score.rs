//! Runs of the tracker and their scores.

use super::world::{Faults, RATE, World};
use stillpoint_detection::{
    BoundingBox, Detections, Object, ObjectId, ObjectState, ObjectTracker, ObjectsConfig,
};
use stillpoint_geometry::Se3;
use stillpoint_imaging::{CoarseDepth, FrameId};

#[derive(Debug, Default, PartialEq)]
pub(crate) struct Score {
    /// Number of id switches of walkers.
    pub(crate) switches: usize,
    /// Overlap of predicted and true box in every frame with a visible, undetected walker whose object is known.
    pub(crate) coasting: Vec<f64>,
    /// Frames with a visible walker, with and without an object. The first ten frames do not count.
    pub(crate) held: usize,
    pub(crate) missed: usize,
    /// Objects beyond one per walker, confirmed or coasting, summed over the frames.
    pub(crate) surplus: usize,
    pub(crate) ids: Vec<ObjectId>,
}

impl Score {
    pub(crate) fn mean(&self) -> f64 {
        self.coasting.iter().sum::<f64>() / self.coasting.len() as f64
    }

    /// A quantile of the overlap in coasting frames.
    pub(crate) fn quantile(&self, share: f64) -> f64 {
        let mut sorted = self.coasting.clone();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().saturating_sub(1) as f64;
        sorted.get((share * last) as usize).copied().unwrap_or(1.0)
    }
}

pub(crate) struct Drive {
    /// Delay of detections, frames.
    pub(crate) lag: u64,
    /// Whether the tracker gets the camera's pose. Controls do not.
    pub(crate) with_pose: bool,
    /// Pose of an empty frame before the first.
    pub(crate) first: Option<Se3>,
}

impl Default for Drive {
    fn default() -> Self {
        Self {
            lag: 0,
            with_pose: true,
            first: None,
        }
    }
}

/// Runs the tracker; predictions are queried every frame, after the detections available then.
pub(crate) fn run(world: &World, faults: &Faults, frames: u64, drive: &Drive) -> Score {
    let mut tracker = ObjectTracker::new(ObjectsConfig::default(), world.camera);
    let mut score = Score::default();
    let mut known: Vec<Option<ObjectId>> = vec![None; world.walkers.len()];
    let pose = |t| {
        if drive.with_pose {
            world.pose(t)
        } else {
            Se3::default()
        }
    };
    if let Some(first) = drive.first {
        let nothing = Detections {
            frame: FrameId(0),
            stamp: -1.0,
            items: Vec::new(),
        };
        tracker.update(&nothing, &first, &CoarseDepth::default());
    }
    for frame in drive.lag..frames {
        let seen = frame - drive.lag;
        let (t, then) = (frame as f64 / RATE, seen as f64 / RATE);
        let late = faults.detect(world, seen);
        tracker.update(&late, &pose(then), &world.depth(then));
        let objects: Vec<Object> = tracker
            .predict(t, &pose(t))
            .into_iter()
            .filter(|o| o.state != ObjectState::Tentative)
            .collect();
        for o in &objects {
            if !score.ids.contains(&o.id) {
                score.ids.push(o.id);
            }
        }
        let in_view = objects.iter().filter(|o| o.bounds.area() > 0.0).count();
        score.surplus += in_view.saturating_sub(world.walkers.len());
        let detections = match drive.lag {
            0 => late,
            _ => faults.detect(world, frame),
        };
        for (n, id) in known.iter_mut().enumerate() {
            let truth = world.truth(n, t);
            judge(&mut score, id, truth, &objects, &detections, frame);
        }
    }
    println!("{score}");
    score
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "switches {}, held {}, missed {}, surplus {}, ids {}, coasting {}: mean {:.3}, 5 % under {:.3}",
            self.switches,
            self.held,
            self.missed,
            self.surplus,
            self.ids.len(),
            self.coasting.len(),
            self.mean(),
            self.quantile(0.05)
        )
    }
}

/// Scores one walker's frame: true box and visible share, objects, and detections.
pub(crate) fn judge(
    score: &mut Score,
    known: &mut Option<ObjectId>,
    truth: Option<(BoundingBox, f64)>,
    objects: &[Object],
    detections: &Detections,
    frame: u64,
) {
    // A walker who left the image may get another id. Hidden walkers are not scored.
    let Some((bounds, open)) = truth else {
        *known = None;
        return;
    };
    if open < 0.5 {
        return;
    }
    let detected = detections.items.iter().any(|d| d.bounds.iou(&bounds) > 0.6);
    let own = known.and_then(|id| objects.iter().find(|o| o.id == id));
    if let Some(own) = own.filter(|_| !detected) {
        score.coasting.push(own.bounds.iou(&bounds));
    }
    let kept = own.filter(|o| o.bounds.iou(&bounds) >= 0.3);
    let found = kept.or_else(|| {
        objects
            .iter()
            .filter(|o| o.bounds.iou(&bounds) >= 0.5)
            .max_by(|a, b| a.bounds.iou(&bounds).total_cmp(&b.bounds.iou(&bounds)))
    });
    if frame >= 10 {
        score.held += usize::from(found.is_some());
        score.missed += usize::from(found.is_none());
    }
    if let Some(found) = found {
        score.switches += usize::from(known.is_some_and(|id| id != found.id));
        *known = Some(found.id);
    }
}
