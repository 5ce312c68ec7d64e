//! Writes meshes as binary PLY, for MeshLab, Blender, CloudCompare and Open3D.

use super::Mesh;
use std::io::{Result, Write};

impl Mesh {
    /// Writes it: vertices with x y z (m, world), nx ny nz, red green blue; faces as index lists.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_ply(&self, mut to: impl Write) -> Result<()> {
        let floats = ["x", "y", "z", "nx", "ny", "nz"].map(|n| format!("property float {n}\n"));
        let bytes = ["red", "green", "blue"].map(|n| format!("property uchar {n}\n"));
        write!(
            to,
            "ply\nformat binary_little_endian 1.0\ncomment metres; Stillpoint\nelement vertex {}\n{}{}element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            self.positions.len(),
            floats.concat(),
            bytes.concat(),
            self.triangles.len()
        )?;
        for ((p, n), c) in self.positions.iter().zip(&self.normals).zip(&self.colours) {
            let mut row = [0; 27];
            for (k, v) in p.iter().chain(n).enumerate() {
                row[4 * k..4 * k + 4].copy_from_slice(&v.to_le_bytes());
            }
            row[24..].copy_from_slice(c);
            to.write_all(&row)?;
        }
        for t in &self.triangles {
            let mut row = [3; 13];
            for (k, i) in t.iter().enumerate() {
                row[1 + 4 * k..5 + 4 * k].copy_from_slice(&i.to_le_bytes());
            }
            to.write_all(&row)?;
        }
        Ok(())
    }
}
