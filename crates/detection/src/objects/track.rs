//! A tracked object: its filter and its detection history.

use super::common::{LOOKS, MUCH, STEP};
use super::depth::DepthMode;
use super::expected::Expected;
use super::fit::CHI2_99;
use super::kalman::{Gaussian, Row};
use super::kind::liveliness;
use super::measurement::Measurement;
use super::place::Place;
use super::planar::Planar;
use super::rigidity::Rigidity;
use super::spatial::Spatial;
use super::view::View;
use super::votes::Votes;
use super::{Motion, Object, ObjectId, ObjectState};
use crate::{BoundingBox, ClassId};
use stillpoint_geometry::Vec3;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Body {
    Spatial(Spatial),
    Planar(Planar),
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Track {
    pub(super) id: ObjectId,
    pub(super) class: ClassId,
    pub(super) score: f32,
    pub(super) body: Body,
    /// For a person, a filter centred on the surface instead of the box: limbs and occlusion move a box's sides.
    pub(super) trunk: Option<Spatial>,
    /// Extent of the surface in front of its median and behind it, m.
    pub(super) reach: [f64; 2],
    pub(super) hits: u32,
    /// Detections since it began or was re-identified.
    pub(super) fresh: u32,
    /// Votes of its detections.
    pub(super) votes: Votes,
    /// Stamp of the first detection, s.
    pub(super) born: f64,
    /// Position at the last detection, m.
    pub(super) seen_at: Option<Vec3>,
    /// Whether re-identification was tried.
    pub(super) known: bool,
    /// Whether another track took over its id.
    pub(super) replaced: bool,
    /// Consecutive updates in which its position was visible without it.
    pub(super) absent: u32,
    /// Whether the border cut its last detection.
    pub(super) cut: bool,
    /// Whether its position showed something else at its last miss.
    pub(super) hidden: bool,
    /// Whether it was leaving or outside the image at its last miss.
    pub(super) leaves: bool,
    /// Updates without a detection since the last one.
    pub(super) misses: u32,
    /// Stamp of the last detection, s.
    pub(super) last_seen: f64,
    /// Consecutive detections whose depth contradicted the state.
    pub(super) contradictions: u32,
    /// Consecutive updates in which it was on the same object as an older track.
    pub(super) duplicate: u32,
    pub(super) rigidity: Rigidity,
    /// Whether the depth image showed it at its position at its last miss.
    pub(super) shows: bool,
    place: Place,
}

impl Track {
    pub(super) fn new(id: ObjectId, view: &View, m: &Measurement, stamp: f64, share: f64) -> Self {
        Self {
            id,
            class: m.detection.class,
            score: m.detection.score,
            body: body_from(view, m, share, liveliness(m.detection.class)),
            trunk: None,
            reach: m.modes.first().map_or([0.0; 2], reach),
            hits: 1,
            fresh: 1,
            votes: Votes::new(&m.detection),
            born: stamp,
            seen_at: None,
            known: false,
            replaced: false,
            absent: 0,
            hidden: false,
            leaves: false,
            cut: m.cut.contains(&true),
            misses: 0,
            last_seen: stamp,
            contradictions: 0,
            duplicate: 0,
            rigidity: Rigidity::default(),
            shows: false,
            place: Place::default(),
        }
    }

    /// Whether it is kept without detections.
    pub(super) fn confirmed(&self) -> bool {
        self.hits >= 2
    }

    /// Middle of its surface in the world, m.
    pub(super) fn position(&self) -> Option<Vec3> {
        match &self.body {
            Body::Spatial(s) => Some(self.trunk.as_ref().unwrap_or(s).position()),
            Body::Planar(_) => None,
        }
    }

    pub(super) fn end_update(&mut self, stamp: f64) {
        self.place.follow(self.position(), stamp);
    }

    /// Whether it is certain enough to be reported: false alarms come twice now and then, and with low scores.
    pub(super) fn reported(&self) -> bool {
        self.hits >= LOOKS && self.votes.suffice()
    }

    pub(super) fn propagate(&mut self, dt: f64, acceleration: f64) {
        let acceleration = acceleration * liveliness(self.class);
        match &mut self.body {
            Body::Spatial(s) => s.propagate(dt, acceleration),
            Body::Planar(p) => p.propagate(dt, acceleration),
        }
        if let Some(trunk) = &mut self.trunk {
            trunk.propagate(dt, acceleration);
        }
    }

    pub(super) fn expected(&self, view: &View) -> Expected {
        let (state, sides, projection) = match &self.body {
            Body::Spatial(s) => {
                let projection = s.project(view);
                let sides = projection.as_ref().map(|p| (p.sides, p.jacobians));
                (&s.state, sides, projection)
            }
            Body::Planar(p) => (&p.state, p.project(view), None),
        };
        let depth_sigma = match (&self.body, &projection) {
            (Body::Spatial(s), Some(p)) => s.depth_variance(p).max(0.0).sqrt(),
            _ => 0.0,
        };
        Expected {
            depth_sigma,
            projection,
            bounds: sides.map_or_else(BoundingBox::default, |(s, _)| view.raw(&s)),
            sides: sides.map(|(s, jacobians)| (s, jacobians.map(|j| state.variance(&j)))),
        }
    }

    /// Box in the raw image; empty when outside.
    pub(super) fn bounds(&self, view: &View) -> BoundingBox {
        self.expected(view).bounds
    }

    /// Standard deviation of the box's vertical and horizontal sides, px.
    fn bounds_sigma(&self, view: &View) -> [f64; 2] {
        let (state, jacobians) = match &self.body {
            Body::Spatial(s) => (&s.state, s.project(view).map(|p| p.jacobians)),
            Body::Planar(p) => (&p.state, p.project(view).map(|p| p.1)),
        };
        let Some(jacobians) = jacobians else {
            return [0.0; 2];
        };
        let variance = |i: usize| state.variance(&jacobians[i]);
        [0, 1].map(|axis| variance(axis).max(variance(axis + 2)).max(0.0).sqrt())
    }

    pub(super) fn absorb(&mut self, view: &View, m: &Measurement, stamp: f64, share: f64) {
        if m.cut.contains(&true) && self.bounds(view).iou(&m.detection.bounds) < MUCH {
            self.restart(view, m, share);
        }
        self.hits = self.hits.saturating_add(1);
        self.fresh = self.fresh.saturating_add(1);
        self.misses = 0;
        self.absent = 0;
        self.hidden = false;
        self.leaves = false;
        self.cut = m.cut.contains(&true);
        self.last_seen = stamp;
        self.score = m.detection.score;
        self.votes.add(&m.detection, self.hits);
        self.class = self.votes.class(self.class);
        let mode = match &mut self.body {
            Body::Planar(p) if m.modes.is_empty() => {
                p.rebase(view);
                let rows = p.rows(view, m, share);
                let ease = excess(&p.state, &rows);
                p.state.update(&eased(rows, ease));
                return;
            }
            Body::Planar(_) => None,
            Body::Spatial(s) => {
                let Some(p) = s.project(view) else {
                    return;
                };
                let mode = s.own_mode(&p, &m.modes).copied();
                let ease = excess(&s.state, &s.rows(&p, m, mode.as_ref(), share));
                let take_in = |s: &mut Spatial, m: &Measurement| {
                    s.update(|s| {
                        let rows = s.project(view).map(|p| s.rows(&p, m, mode.as_ref(), share));
                        eased(rows.unwrap_or_default(), ease)
                    });
                };
                match &mut self.trunk {
                    Some(trunk) => take_in(trunk, m),
                    None if m.middle.is_some() => self.trunk = Some(s.clone()),
                    None => {}
                }
                take_in(
                    s,
                    &Measurement {
                        middle: None,
                        ..m.clone()
                    },
                );
                if m.modes.is_empty() {
                    return;
                }
                mode
            }
        };
        self.judge_depth(view, m, mode, share);
    }

    /// Restarts from the box alone, keeping the velocity: an object entering at the border grows faster than the size
    /// model allows.
    fn restart(&mut self, view: &View, m: &Measurement, share: f64) {
        let mut body = body_from(view, m, share, liveliness(self.class));
        if let (Body::Spatial(old), Body::Spatial(new)) = (&self.body, &mut body) {
            let velocity = old.state.mean.fixed_rows::<3>(3).into_owned();
            new.state.mean.fixed_rows_mut::<3>(3).copy_from(&velocity);
            self.body = body;
            self.trunk = None;
        }
    }

    /// Continues an object that was out of sight, which is already certain.
    pub(super) fn return_as(&mut self, id: ObjectId, sure: bool) {
        self.id = id;
        self.known = true;
        self.place.begin_anew();
        self.hits = self.hits.max(LOOKS);
        self.votes.are_enough(sure);
    }

    /// Maximum time without detections, s: no longer than it was tracked, so that false alarms end soon.
    pub(super) fn patience(&self, coast: f64) -> f64 {
        (self.last_seen - self.born + STEP).min(coast)
    }

    /// After a detection: records the position and applies rest constraints.
    pub(super) fn settle(&mut self, down: &Vec3) {
        let parked = self.rigidity.motion() == Motion::Parked;
        let may_rest = liveliness(self.class) < 1.0;
        if let Body::Spatial(s) = &mut self.body {
            s.settle(down, may_rest, parked);
            if let Some(trunk) = &mut self.trunk {
                trunk.settle(down, may_rest, parked);
            }
            self.seen_at = Some(s.position());
        }
    }

    /// Updates the extent of the object's surface, or restarts the depth after repeated contradictions.
    fn judge_depth(&mut self, view: &View, m: &Measurement, own: Option<DepthMode>, share: f64) {
        let nearest = m.modes[0];
        let behind = own.is_some_and(|o| o.depth > nearest.depth && nearest.share >= 0.6);
        self.contradictions = if own.is_none() || behind {
            self.contradictions + 1
        } else {
            0
        };
        let planar = matches!(self.body, Body::Planar(_));
        if planar || self.contradictions >= LOOKS {
            self.body = body_from(view, m, share, liveliness(self.class));
            self.trunk = None;
            self.reach = reach(&nearest);
            self.contradictions = 0;
        } else if let Some(own) = own {
            let new = reach(&own);
            for (kept, new) in self.reach.iter_mut().zip(new) {
                *kept += 0.3 * (new - *kept);
            }
        }
    }

    /// Whether the state is too uncertain to be useful: the position by twice the object's size. Without depth, by the
    /// box's size.
    pub(super) fn vague(&self) -> bool {
        match &self.body {
            Body::Spatial(s) => {
                let c = &s.state.covariance;
                let variance = (c[(0, 0)] + c[(1, 1)] + c[(2, 2)]) / 3.0;
                let [w, h] = s.size();
                let limit = 2.0 * w.max(h);
                variance > limit * limit
            }
            Body::Planar(p) => {
                let c = &p.state.covariance;
                let variance = (c[(0, 0)] + c[(1, 1)]) / 2.0;
                let extent = libm::exp(p.state.mean[2].max(p.state.mean[3]).min(20.0));
                variance > 4.0 * extent * extent
            }
        }
    }

    pub(super) fn object(&self, view: &View) -> Object {
        let sure = self.reported()
            && self.place.is_steady()
            && (self.votes.sure() || liveliness(self.class) < 1.0);
        let placed = self.place.stamp();
        let unseen = !self.shows && placed.is_some_and(|now| now - self.last_seen > STEP);
        let state = match (sure, self.misses) {
            (false, _) => ObjectState::Tentative,
            (true, 0) => ObjectState::Confirmed,
            (true, _) if self.hidden || self.leaves || unseen => ObjectState::Hidden,
            (true, _) => ObjectState::Coasting,
        };
        let mut object = Object {
            id: self.id,
            class: self.class,
            score: self.score,
            state,
            bounds: self.bounds(view),
            bounds_sigma: self.bounds_sigma(view),
            depth_range: None,
            position: None,
            velocity: None,
            covariance: None,
            size: None,
            last_seen: self.last_seen,
            motion: self.rigidity.motion(),
        };
        if let Body::Spatial(s) = &self.body {
            let middle = self.trunk.as_ref().unwrap_or(s);
            let mut covariance = middle.covariance();
            let lag = self.place.lag();
            let mut of_position = covariance.fixed_view_mut::<3, 3>(0, 0);
            of_position += lag * lag.transpose();
            object.position = Some(middle.position() - lag);
            object.velocity = Some(middle.velocity());
            object.covariance = Some(covariance);
            object.size = Some(s.size());
            object.depth_range = s.project(view).map(|p| {
                let sigma = s.depth_variance(&p).max(0.0).sqrt();
                let least = MUCH * s.size()[0];
                let [front, back] = self.reach.map(|r| r.max(least));
                [(p.z - front - sigma).max(0.0), p.z + back + sigma]
            });
        }
        object
    }
}

fn body_from(view: &View, m: &Measurement, share: f64, liveliness: f64) -> Body {
    match m.modes.first() {
        Some(mode) => Body::Spatial(Spatial::new(view, m, mode, share, liveliness)),
        None => Body::Planar(Planar::new(view, m, share)),
    }
}

fn reach(mode: &DepthMode) -> [f64; 2] {
    [mode.depth - mode.range[0], mode.range[1] - mode.depth]
}

/// Mahalanobis distance of an accepted detection relative to the gate: 1 within it.
fn excess(state: &Gaussian, rows: &[Row]) -> f64 {
    (state.distance(rows) / CHI2_99[rows.len().min(5)].max(1.0)).max(1.0)
}

/// Inflates the variances of a detection outside the gate.
fn eased(mut rows: Vec<Row>, excess: f64) -> Vec<Row> {
    for row in &mut rows {
        row.variance *= excess;
    }
    rows
}
