//! Writes the coarse grid as an octree in OctoMap's binary format (`.bt`): Hornung et al., Autonomous Robots 2013.

use crate::world::{DenseMap, Occupancy};
use std::io::{Result, Write};

/// Levels of the tree: keys have 16 bits.
const DEPTH: u32 = 16;
/// Key of the cell at the origin, along each axis.
const MIDDLE: i64 = 1 << (DEPTH - 1);

/// A leaf: its interleaved key bits from the highest down (z, y, x), and whether it is occupied.
type Leaf = (u64, bool);

impl DenseMap {
    /// Writes the occupied and the free cells. Those beyond 32768 cells from the origin are left out.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_octomap(&self, mut to: impl Write) -> Result<()> {
        let mut leaves = Vec::new();
        self.for_each_known(|at, occupancy| {
            if let Some(key) = key(at) {
                leaves.push((key, occupancy == Occupancy::Occupied));
            }
        });
        leaves.sort_unstable();
        let mut nodes = Vec::new();
        let count = if leaves.is_empty() {
            0
        } else {
            node(&leaves, DEPTH, &mut nodes)
        };
        write!(
            to,
            "# Octomap OcTree binary file\n# cells of {} m; Stillpoint\nid OcTree\nsize {count}\nres {}\ndata\n",
            self.cell_side(),
            self.cell_side()
        )?;
        to.write_all(&nodes)
    }
}

fn key(at: [i32; 3]) -> Option<u64> {
    let mut key = 0;
    for (axis, v) in at.iter().enumerate() {
        let v = u64::try_from(i64::from(*v) + MIDDLE).ok()?;
        if v >> DEPTH != 0 {
            return None;
        }
        for bit in 0..DEPTH {
            key |= (v >> bit & 1) << (3 * bit as usize + axis);
        }
    }
    Some(key)
}

/// The common value of a node's leaves, if all exist and agree.
fn uniform(leaves: &[Leaf], levels: u32) -> Option<bool> {
    let first = leaves.first()?.1;
    let full = leaves.len() as u64 == 1 << (3 * levels);
    (full && leaves.iter().all(|l| l.1 == first)).then_some(first)
}

/// Writes an inner node with this many levels below it, and returns the number of nodes written.
fn node(leaves: &[Leaf], levels: u32, out: &mut Vec<u8>) -> usize {
    let shift = 3 * (levels - 1);
    let mut children: [&[Leaf]; 8] = [&[]; 8];
    let mut rest = leaves;
    for (i, child) in children.iter_mut().enumerate() {
        let end = rest.partition_point(|l| (l.0 >> shift & 7) as usize <= i);
        (*child, rest) = rest.split_at(end);
    }
    // Two bits per child: 01 free, 10 occupied, 11 has children.
    let mut record = 0_u16;
    for (i, child) in children.iter().enumerate() {
        let bits = match (child.is_empty(), uniform(child, levels - 1)) {
            (true, _) => 0,
            (_, Some(false)) => 1,
            (_, Some(true)) => 2,
            (_, None) => 3,
        };
        record |= bits << (2 * i);
    }
    out.extend(record.to_le_bytes());
    let mut count = 1;
    for (i, child) in children.iter().enumerate() {
        count += match record >> (2 * i) & 3 {
            0 => 0,
            3 => node(child, levels - 1, out),
            _ => 1,
        };
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a tree as OctoMap does: leaves with the levels below them.
    fn read(bytes: &mut &[u8], levels: u32, at: u64, leaves: &mut Vec<(u64, u32, bool)>) -> usize {
        let record = u16::from_le_bytes([bytes[0], bytes[1]]);
        *bytes = &bytes[2..];
        let mut count = 1;
        for i in 0..8_u64 {
            let child = at << 3 | i;
            match record >> (2 * i) & 3 {
                0 => {}
                3 => count += read(bytes, levels - 1, child, leaves),
                v => {
                    leaves.push((child, levels - 1, v == 2));
                    count += 1;
                }
            }
        }
        count
    }

    #[test]
    fn octree_contains_every_leaf_once_and_merges_equal_ones() {
        let mut leaves = Vec::new();
        for x in -3..5 {
            for y in 0..4 {
                for z in -2..2 {
                    leaves.push((key([x, y, z]).unwrap(), x < 2));
                }
            }
        }
        leaves.sort_unstable();
        let mut bytes = Vec::new();
        let count = node(&leaves, DEPTH, &mut bytes);
        let (mut rest, mut found) = (&*bytes, Vec::new());
        assert_eq!(
            (read(&mut rest, DEPTH, 0, &mut found), rest.len()),
            (count, 0)
        );
        assert!(found.iter().any(|f| f.1 > 0), "nothing was joined");
        let mut all: Vec<Leaf> = found
            .iter()
            .flat_map(|(k, levels, o)| {
                let n = 1_u64 << (3 * levels);
                (0..n).map(move |i| (k * n + i, *o))
            })
            .collect();
        all.sort_unstable();
        assert_eq!(all, leaves);
        assert_eq!((key([40_000, 0, 0]), key([0, i32::MIN, 0])), (None, None));
    }
}
