//! The cases of marching cubes (Lorensen, Cline, SIGGRAPH 1987), derived instead of listed.
//!
//! On each face of the cube the surface separates each group of adjacent inside corners; diagonally opposite ones are separated from each
//! other. The result on a face depends only on that face, so that adjacent cubes agree, and the surface is closed wherever everything is
//! known (the ambiguity described by Nielson, Hamann, IEEE Visualization 1991).

/// Corner `c` is at `x = c & 1, y = c >> 1 & 1, z = c >> 2`. Edge `4 axis + k` begins at this corner and goes along its axis.
pub(super) const EDGE_STARTS: [usize; 12] = [0, 2, 4, 6, 0, 1, 4, 5, 0, 1, 2, 3];

/// Triangles of each of the 256 cases, as edges; bit `c` of the case says that corner `c` is inside. Counter-clockwise as seen from outside
/// of the surface.
pub(super) struct Table(Vec<Vec<[u8; 3]>>);

impl Table {
    pub(super) fn new() -> Self {
        Self((0..256).map(triangles).collect())
    }

    pub(super) fn triangles(&self, case: u8) -> &[[u8; 3]] {
        &self.0[usize::from(case)]
    }
}

fn edge(a: usize, b: usize) -> usize {
    let (start, axis) = (a & b, (a ^ b).trailing_zeros() as usize);
    let found = (0..4).find(|k| EDGE_STARTS[4 * axis + k] == start);
    4 * axis + found.unwrap_or(0)
}

/// The corners of the six faces, counter-clockwise as seen from outside of the cube.
fn faces() -> [[usize; 4]; 6] {
    std::array::from_fn(|f| {
        let (axis, far) = (f / 2, f % 2);
        let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let base = far << axis;
        if far == 1 {
            [base, base | u, base | u | v, base | v]
        } else {
            [base, base | v, base | u | v, base | u]
        }
    })
}

fn triangles(case: usize) -> Vec<[u8; 3]> {
    let inside = |c: usize| case >> c & 1 == 1;
    // For each edge that the surface crosses, the next one along the contour.
    let mut next = [None; 12];
    for face in faces() {
        for i in 0..4 {
            let (before, first) = (face[i], face[(i + 1) % 4]);
            if inside(before) || !inside(first) {
                continue;
            }
            // A group of inside corners starts here; find its end.
            let mut k = i + 1;
            while inside(face[(k + 1) % 4]) {
                k += 1;
            }
            let (last, after) = (face[k % 4], face[(k + 1) % 4]);
            next[edge(before, first)] = Some(edge(last, after));
        }
    }
    let (mut out, mut done) = (Vec::new(), [false; 12]);
    for start in 0..12 {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(to) = next[at].filter(|_| !done[at]) {
            done[at] = true;
            ring.push(at);
            at = to;
        }
        if let Some(found) = cut(&ring) {
            out.extend(found);
        }
    }
    out
}

/// Triangulates a ring of edges without a diagonal on a face of the cube: the adjacent cube may have the same diagonal, and an edge would
/// belong to four triangles.
fn cut(ring: &[usize]) -> Option<Vec<[u8; 3]>> {
    let n = ring.len();
    if n < 3 {
        return None;
    }
    if n == 3 {
        return Some(vec![std::array::from_fn(|i| ring[i] as u8)]);
    }
    for i in 0..n {
        let (a, b, c) = (ring[i], ring[(i + 1) % n], ring[(i + 2) % n]);
        if on_one_face(a, c) {
            continue;
        }
        let mut rest = ring.to_vec();
        rest.remove((i + 1) % n);
        if let Some(mut found) = cut(&rest) {
            found.push([a as u8, b as u8, c as u8]);
            return Some(found);
        }
    }
    None
}

fn on_one_face(a: usize, b: usize) -> bool {
    let ends = |e: usize| [EDGE_STARTS[e], EDGE_STARTS[e] | 1 << (e / 4)];
    faces().iter().any(|face| {
        let all = [ends(a), ends(b)].concat();
        all.iter().all(|c| face.contains(c))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn middle(e: u8) -> [f64; 3] {
        let (start, axis) = (EDGE_STARTS[usize::from(e)], usize::from(e) / 4);
        std::array::from_fn(|i| {
            let at = (start >> i & 1) as f64;
            if i == axis { 0.5 } else { at }
        })
    }

    #[test]
    fn exactly_the_crossed_edges_are_used() {
        let table = Table::new();
        for case in 0..=255_u8 {
            let used: std::collections::BTreeSet<u8> =
                table.triangles(case).iter().flatten().copied().collect();
            for e in 0..12_u8 {
                let start = EDGE_STARTS[usize::from(e)];
                let end = start | 1 << (e / 4);
                let crossed = (case >> start ^ case >> end) & 1 == 1;
                assert_eq!(used.contains(&e), crossed, "case {case} edge {e}");
            }
        }
    }

    /// Within a cube each triangle edge is used twice, in both directions, unless it is on a face.
    #[test]
    fn surfaces_end_only_on_cell_faces() {
        let table = Table::new();
        for case in 0..=255_u8 {
            let mut sides = Vec::new();
            for [a, b, c] in table.triangles(case) {
                sides.extend([(*a, *b), (*b, *c), (*c, *a)]);
            }
            for (a, b) in &sides {
                let there = sides.iter().filter(|s| **s == (*a, *b)).count();
                let back = sides.iter().filter(|s| **s == (*b, *a)).count();
                let face = on_one_face((*a).into(), (*b).into());
                assert_eq!((there, back), (1, usize::from(!face)), "case {case}");
            }
        }
    }

    #[test]
    fn triangles_face_outward() {
        let table = Table::new();
        for corner in 0..8 {
            let [t] = table.triangles(1 << corner) else {
                panic!("one corner is cut off by one triangle");
            };
            let p = t.map(middle);
            let d = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| b[i] - a[i]) };
            let (u, v) = (d(p[0], p[1]), d(p[0], p[2]));
            let n = [
                u[1] * v[2] - u[2] * v[1],
                u[2] * v[0] - u[0] * v[2],
                u[0] * v[1] - u[1] * v[0],
            ];
            let at: [f64; 3] = std::array::from_fn(|i| (corner >> i & 1) as f64);
            let out = d(at, p[0]);
            assert!(n.iter().zip(out).map(|(a, b)| a * b).sum::<f64>() > 0.0);
        }
    }
}
