//! The ground: free floor and walls, by which rooms are segmented.
//!
//! A coarse plan per submap, whose cells are anchored to the keyframes that saw them first, so that it follows corrections as objects do.

use super::look::Placed;
use super::part::Point;
use crate::floor::Floor;
use crate::rooms::{Ground, around, rooms};
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_geometry::{Mat3, Vec3};
use stillpoint_map::{KeyframeId, MapView, SubmapId};

/// Side of a cell, m.
const SIDE: f64 = 0.1;
/// Height range of walls, and of shelves along them, m: above chairs, desks and screens and below door tops.
const WALLS: [f64; 2] = [1.35, 1.95];
/// Height range in which a line of sight shows free floor, m.
const BAND: [f64; 2] = [0.05, 1.95];
/// Step between points of the reduced image that are searched for walls, along rows and columns, in points.
const WALL_STEP: usize = 2;
/// Step between points of the reduced image whose lines of sight are followed, along rows and columns, in points.
const RAY_STEP: usize = 4;
/// Maximum distance of points, m: farther ones are too uncertain for cells of this size.
const FAR: f64 = 5.0;
/// Maximum number of views used; more add nothing.
const MOST_LOOKS: usize = 600;
/// Minimum number of points of a wall.
const LEAST_POINTS: u32 = 3;
/// Minimum number of wall points per line of sight through the cell: at object borders, depth is sometimes that of the background.
const LEAST_SHARE: f64 = 0.3;
/// Weight of an earlier run's knowledge, in points or lines of sight.
const KNOWN: u32 = 6;
/// Maximum distance of cells from the origin of a plan, and maximum number of cells: 200 m x 200 m.
const MOST_CELLS: i32 = 100_000;
const MOST_AREA: usize = 4_000_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Spot {
    pub(crate) at: Point,
    pub(crate) wall: bool,
}

#[derive(Clone, Copy)]
struct Counts {
    walls: u32,
    open: u32,
    /// Anchor to the keyframe that saw it first.
    at: Point,
}

type Cells = BTreeMap<(SubmapId, [i32; 2]), Counts>;

pub(crate) fn ground(
    known: &[Spot],
    looks: &[Placed<'_>],
    levels: &BTreeMap<SubmapId, Floor>,
    view: &MapView,
) -> Vec<Spot> {
    let mut cells = Cells::new();
    let mut spots = Vec::new();
    for spot in known {
        let Some((submap, at)) = locate(spot, levels, view) else {
            spots.push(*spot);
            continue;
        };
        let counts = cells.entry((submap, at)).or_insert(Counts::new(spot.at));
        let of = if spot.wall {
            &mut counts.walls
        } else {
            &mut counts.open
        };
        *of += KNOWN;
    }
    let every = looks.len().div_ceil(MOST_LOOKS).max(1);
    for placed in looks.iter().step_by(every) {
        if let Some(floor) = levels.get(&placed.submap) {
            add(placed, &Level::new(floor), &mut cells);
        }
    }
    spots.extend(cells.values().map(Counts::spot));
    spots
}

fn locate(
    spot: &Spot,
    levels: &BTreeMap<SubmapId, Floor>,
    view: &MapView,
) -> Option<(SubmapId, [i32; 2])> {
    let submap = view.submap_of(spot.at.keyframe)?;
    let level = Level::new(levels.get(&submap)?);
    let at = level.cell(&spot.at.world(view)?);
    at.iter()
        .all(|v| v.abs() < MOST_CELLS)
        .then_some((submap, at))
}

struct Level<'a> {
    floor: &'a Floor,
    turn: Mat3,
}

impl<'a> Level<'a> {
    fn new(floor: &'a Floor) -> Self {
        Self {
            floor,
            turn: floor.level_from_world(),
        }
    }

    fn cell(&self, p: &Vec3) -> [i32; 2] {
        let local = self.turn * p;
        [local.x, local.y].map(|v| (v / SIDE).floor() as i32)
    }

    fn middle(&self, at: [i32; 2]) -> Vec3 {
        let [x, y] = at.map(|v| (f64::from(v) + 0.5) * SIDE);
        self.turn.transpose() * Vec3::new(x, y, self.floor.offset)
    }
}

impl Counts {
    fn new(at: Point) -> Self {
        Self {
            walls: 0,
            open: 0,
            at,
        }
    }

    fn spot(&self) -> Spot {
        let share = f64::from(self.walls) >= LEAST_SHARE * f64::from(self.open);
        Spot {
            at: self.at,
            wall: self.walls >= LEAST_POINTS && share,
        }
    }
}

fn add(placed: &Placed<'_>, level: &Level<'_>, cells: &mut Cells) {
    let columns = placed.grid.columns;
    let eye = placed.world_from_camera.translation;
    let mut walls = Vec::new();
    // Each cell counts once per view, so that near ones do not count more than far ones.
    let mut open = BTreeSet::new();
    for i in 0..columns * placed.grid.rows {
        let (x, y) = (i % columns, i / columns);
        if x % WALL_STEP != 0 || y % WALL_STEP != 0 {
            continue;
        }
        let Some(p) = placed.in_camera(i).filter(|p| p.z < FAR) else {
            continue;
        };
        let p = placed.world_from_camera.transform(&p);
        if (WALLS[0]..WALLS[1]).contains(&level.floor.height(&p)) {
            walls.push(level.cell(&p));
        }
        if x % RAY_STEP == 0 && y % RAY_STEP == 0 {
            follow(level, [&eye, &p], &mut open);
        }
    }
    for (at, wall) in walls
        .into_iter()
        .map(|at| (at, true))
        .chain(open.into_iter().map(|at| (at, false)))
    {
        let fits = at.iter().all(|v| v.abs() < MOST_CELLS);
        let Some(point) = placed.keep_world(&level.middle(at)).filter(|_| fits) else {
            continue;
        };
        let counts = cells
            .entry((placed.submap, at))
            .or_insert(Counts::new(point));
        let of = if wall {
            &mut counts.walls
        } else {
            &mut counts.open
        };
        *of += 1;
    }
}

/// The cells that a line of sight crosses before its end.
fn follow(level: &Level<'_>, [from, to]: [&Vec3; 2], open: &mut BTreeSet<[i32; 2]>) {
    let steps = ((to - from).norm() / SIDE).floor();
    // The last cell is that of the surface itself, unless that is the floor.
    let floor = level.floor.height(to) < BAND[0];
    let end = if floor { steps } else { steps - 1.0 };
    for k in 0..end.max(0.0) as usize {
        let p = from + (to - from) * (k as f64 / steps);
        if level.floor.height(&p) < BAND[1] {
            open.insert(level.cell(&p));
        }
    }
}

/// A room in a map: ground enclosed by walls and doors.
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    /// Its number, from 1, in the order in which rooms were entered.
    pub number: u32,
    /// The submap of its frame of reference.
    pub submap: SubmapId,
    /// The centre of its ground, m, world.
    pub centre: Vec3,
    /// Area of its known ground, m^2.
    pub area: f64,
}

struct Plan<'a> {
    level: Level<'a>,
    first: [i32; 2],
    width: usize,
    rooms: Vec<u32>,
    walls: Vec<bool>,
}

pub(crate) struct RoomMap<'a> {
    plans: BTreeMap<SubmapId, Plan<'a>>,
    pub(crate) rooms: Vec<Room>,
}

impl<'a> RoomMap<'a> {
    pub(crate) fn new(
        spots: &[Spot],
        levels: &'a BTreeMap<SubmapId, Floor>,
        view: &MapView,
    ) -> Self {
        let mut by_submap: BTreeMap<SubmapId, BTreeMap<[i32; 2], (bool, KeyframeId)>> =
            BTreeMap::new();
        for spot in spots {
            if let Some((submap, at)) = locate(spot, levels, view) {
                let cells = by_submap.entry(submap).or_default();
                let cell = cells.entry(at).or_insert((spot.wall, spot.at.keyframe));
                // Corrections may move two spots into one cell.
                *cell = (cell.0 || spot.wall, cell.1.min(spot.at.keyframe));
            }
        }
        let mut map = Self {
            plans: BTreeMap::new(),
            rooms: Vec::new(),
        };
        for (submap, cells) in by_submap {
            if let Some(floor) = levels.get(&submap) {
                map.add(submap, Level::new(floor), &cells);
            }
        }
        map
    }

    fn add(
        &mut self,
        submap: SubmapId,
        level: Level<'a>,
        cells: &BTreeMap<[i32; 2], (bool, KeyframeId)>,
    ) {
        let far = [i32::MAX, i32::MIN];
        let range = |k: usize| {
            cells
                .keys()
                .fold(far, |r, at| [r[0].min(at[k]), r[1].max(at[k])])
        };
        let ([x0, x1], [y0, y1]) = (range(0), range(1));
        let (width, height) = ((x1 - x0 + 1) as usize, (y1 - y0 + 1) as usize);
        if width.saturating_mul(height) > MOST_AREA {
            return;
        }
        let index = |at: &[i32; 2]| (at[1] - y0) as usize * width + (at[0] - x0) as usize;
        let mut plan = vec![Ground::Unknown; width * height];
        for (at, (wall, _)) in cells {
            plan[index(at)] = if *wall { Ground::Wall } else { Ground::Open };
        }
        let labels = rooms(&plan, width, SIDE);
        let walls = plan.iter().map(|c| *c == Ground::Wall).collect();
        // By label its cells, and the keyframe that saw the first of them.
        let mut found: BTreeMap<u32, (KeyframeId, Vec3, u32)> = BTreeMap::new();
        for (at, (_, keyframe)) in cells {
            let label = labels[index(at)];
            if label > 0 {
                let room = found.entry(label).or_insert((*keyframe, Vec3::zeros(), 0));
                *room = (
                    room.0.min(*keyframe),
                    room.1 + level.middle(*at),
                    room.2 + 1,
                );
            }
        }
        let mut order: Vec<(KeyframeId, u32)> = found.iter().map(|(l, f)| (f.0, *l)).collect();
        order.sort_unstable();
        let mut numbers = vec![0; found.len() + 1];
        for (_, label) in order {
            let (_, sum, count) = found[&label];
            let number = self.rooms.len() as u32 + 1;
            numbers[label as usize] = number;
            self.rooms.push(Room {
                number,
                submap,
                centre: sum / f64::from(count),
                area: f64::from(count) * SIDE * SIDE,
            });
        }
        let plan = Plan {
            level,
            first: [x0, y0],
            width,
            rooms: labels.iter().map(|l| numbers[*l as usize]).collect(),
            walls,
        };
        self.plans.insert(submap, plan);
    }

    /// The room of a world point: that of the ground below it, or of the nearest ground without a wall in between.
    pub(crate) fn room(&self, submap: SubmapId, p: &Vec3) -> Option<u32> {
        let plan = self.plans.get(&submap)?;
        let height = plan.rooms.len() / plan.width;
        let at = plan.level.cell(p);
        // Objects at a wall may lie slightly outside of the ground.
        let x = (at[0] - plan.first[0]).clamp(0, plan.width as i32 - 1) as usize;
        let y = (at[1] - plan.first[1]).clamp(0, height as i32 - 1) as usize;
        let first = y * plan.width + x;
        let mut marked = vec![false; plan.rooms.len()];
        let mut cells = vec![first];
        marked[first] = true;
        let mut next = 0;
        while let Some(i) = cells.get(next).copied() {
            next += 1;
            if plan.rooms[i] > 0 {
                return Some(plan.rooms[i]);
            }
            for j in around(i, plan.width, plan.rooms.len()) {
                // May leave a wall but not enter one.
                if !marked[j] && !plan.walls[j] {
                    marked[j] = true;
                    cells.push(j);
                }
            }
        }
        None
    }
}
