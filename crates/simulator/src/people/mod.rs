//! People who walk, stop, turn, sit down, talk and carry: articulated bodies as functions of time.
//!
//! A person is a route (`route`), a way of moving along it (`gait`), bones (`skeleton`) and a clothed body (`body`). The people of each
//! scene are in `cast`.

mod body;
mod cast;
mod gait;
mod mesh;
mod route;
mod skeleton;

pub(crate) use body::{Body, Dress};
pub(crate) use cast::Cast;

use crate::scene::{Face, Light};
use crate::truth::{MoverMotion, MoverState, ThingBox};
use gait::Gait;
use mesh::{Cover, Mesh};
use skeleton::Skeleton;
use stillpoint_geometry::{Vec3, so3};

/// Selects faces.
pub(crate) trait Asked {
    /// Whether any face within a box of these corners may be selected.
    fn about(&self, corners: &[Vec3; 8]) -> bool;

    /// Whether to select the face of these corners and this normal; selected faces are added in this order.
    fn asks(&mut self, corners: &[Vec3; 3], normal: &Vec3) -> bool;
}

/// A person with or without a load.
pub(crate) struct Person {
    gait: Gait,
    body: Body,
    load: Vec<(Mesh, Cover)>,
    /// Whether the camera sees the person's back throughout the scene.
    from_behind: bool,
}

impl Person {
    /// The person at a time (s), and its load, in the order of their mover numbers.
    pub(crate) fn movers(&self, stamp: f64) -> impl Iterator<Item = MoverState> {
        let hips = |t| self.gait.posture(t).hips;
        let person = state("person", stamp, |t| Some(hips(t)));
        let person = person.map(|p| MoverState {
            from_behind: self.from_behind,
            ..p
        });
        let class = self.gait.load.map_or("box", |l| l.class);
        let carried = state(class, stamp, |t| Some(self.gait.load_pose(t)?.translation));
        person.into_iter().chain(carried)
    }

    /// Adds the selected faces of the person at a time (s).
    pub(crate) fn place(
        &self,
        stamp: f64,
        light: &Light,
        asked: &mut dyn Asked,
        out: &mut Vec<Face>,
    ) {
        let skeleton = Skeleton::new(&self.gait.posture(stamp));
        self.body.place(&skeleton, light, asked, out);
        if let Some(pose) = self.gait.load_pose(stamp) {
            for (mesh, cover) in &self.load {
                mesh.place(&pose, *cover, light, asked, out);
            }
        }
    }

    /// Mover number and box of an object that stands until this person takes it.
    pub(crate) fn taken(&self) -> Option<(u32, ThingBox)> {
        let load = self.gait.load?;
        let standing = load.stands?;
        let mover = self.load.first()?.1.mover;
        let parts = self.load.iter().map(|(mesh, _)| mesh.bounds());
        let [low, high] = parts.reduce(|a, b| [a[0].inf(&b[0]), a[1].sup(&b[1])])?;
        let turn = so3::exp(&(Vec3::z() * standing.yaw));
        let middle = Vec3::from(standing.at) + turn * (0.5 * (low + high));
        let thing = ThingBox {
            class: load.class,
            centre: middle.into(),
            size: (high - low).into(),
            yaw: standing.yaw,
            taken_at: Some(standing.until),
        };
        Some((u32::from(mover), thing))
    }
}

/// Half of the interval for computing velocities, s: short relative to a step, and long relative to the rounding of positions.
const HALF_SPAN: f64 = 0.005;

/// A mover whose position is a function of time.
fn state(class: &'static str, stamp: f64, at: impl Fn(f64) -> Option<Vec3>) -> Option<MoverState> {
    let (before, after) = (at(stamp - HALF_SPAN)?, at(stamp + HALF_SPAN)?);
    Some(MoverState {
        class,
        from_behind: false,
        motion: Some(MoverMotion {
            position: at(stamp)?.into(),
            velocity: ((after - before) / (2.0 * HALF_SPAN)).into(),
        }),
    })
}

#[cfg(test)]
pub(crate) struct All;

#[cfg(test)]
impl Asked for All {
    fn about(&self, _: &[Vec3; 8]) -> bool {
        true
    }

    fn asks(&mut self, _: &[Vec3; 3], _: &Vec3) -> bool {
        true
    }
}

#[cfg(test)]
impl Person {
    /// All vertices of body and load in the world.
    fn corners(&self, t: f64) -> Vec<Vec3> {
        let mut faces = Vec::new();
        self.place(t, &Light::default(), &mut All, &mut faces);
        faces.iter().flat_map(|f| f.vertices.to_vec()).collect()
    }
}

#[cfg(test)]
mod tests;
