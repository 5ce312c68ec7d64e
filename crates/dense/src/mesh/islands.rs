//! Removes small disconnected pieces: noise and remains of moved objects.

use super::Mesh;

impl Mesh {
    /// Removes the connected components with less area than this, m^2, and their vertices.
    pub(super) fn remove_islands(&mut self, min_area: f64) {
        if min_area <= 0.0 {
            return;
        }
        let mut root: Vec<u32> = (0..self.positions.len() as u32).collect();
        for [a, b, c] in &self.triangles {
            join(&mut root, *a, *b);
            join(&mut root, *a, *c);
        }
        let mut areas = vec![0.0; root.len()];
        for t in &self.triangles {
            areas[find(&mut root, t[0]) as usize] += 0.5 * self.area_vector(t).norm();
        }
        let stays: Vec<bool> = (0..root.len() as u32)
            .map(|i| areas[find(&mut root, i) as usize] >= min_area)
            .collect();
        let mut count = 0;
        let renamed: Vec<u32> = stays
            .iter()
            .map(|s| {
                count += u32::from(*s);
                count.wrapping_sub(1)
            })
            .collect();
        self.triangles.retain(|t| stays[t[0] as usize]);
        for t in &mut self.triangles {
            *t = t.map(|i| renamed[i as usize]);
        }
        let mut kept = stays.iter();
        self.positions.retain(|_| kept.next() == Some(&true));
        let mut kept = stays.iter();
        self.colours.retain(|_| kept.next() == Some(&true));
    }
}

/// Union-find root, with path compression.
fn find(root: &mut [u32], mut i: u32) -> u32 {
    while root[i as usize] != i {
        let up = root[root[i as usize] as usize];
        root[i as usize] = up;
        i = up;
    }
    i
}

fn join(root: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(root, a), find(root, b));
    // The smaller index becomes the root, independent of the triangle order.
    root[a.max(b) as usize] = a.min(b);
}
