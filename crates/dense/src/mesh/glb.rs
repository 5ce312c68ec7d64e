//! Writes meshes as glTF 2.0 in one file (GLB), for browsers, Windows and Blender.

use super::Mesh;
use std::io::{Error, ErrorKind, Result, Write};
use stillpoint_geometry::{Vec3, nalgebra::UnitQuaternion};

/// Bytes per vertex: position and normal as floats, colour with a constant alpha byte.
const POSITIONS: usize = 12;
const COLOUR: usize = 4;

impl Mesh {
    /// Writes it. `up` is the direction away from the floor in the world, which becomes y in glTF; for a world that begins with an upright
    /// camera it is -y.
    ///
    /// # Errors
    /// Errors of the writer, and a mesh of more than 4 GiB, which the format cannot hold.
    pub fn write_glb(&self, mut to: impl Write, up: Option<&Vec3>) -> Result<()> {
        let (corners, triangles) = (self.positions.len(), self.triangles.len());
        let sizes = [
            POSITIONS * corners,
            POSITIONS * corners,
            COLOUR * corners,
            12 * triangles,
        ];
        let binary: usize = sizes.iter().sum();
        let json = self.json(sizes, up);
        let padded = json.len().next_multiple_of(4);
        let total = 12 + 8 + padded + 8 + binary;
        let number = |n: usize| {
            u32::try_from(n).map_err(|_| {
                Error::new(
                    ErrorKind::InvalidInput,
                    "expected a mesh of less than 4 GiB, the most that GLB holds; write PLY, or take larger voxels",
                )
            })
        };
        let mut head = b"glTF".to_vec();
        head.extend(2_u32.to_le_bytes());
        head.extend(number(total)?.to_le_bytes());
        head.extend(number(padded)?.to_le_bytes());
        head.extend(b"JSON");
        head.extend(
            json.bytes()
                .chain(std::iter::repeat_n(b' ', padded - json.len())),
        );
        head.extend(number(binary)?.to_le_bytes());
        head.extend(b"BIN\0");
        to.write_all(&head)?;
        for v in self.positions.iter().chain(&self.normals).flatten() {
            to.write_all(&v.to_le_bytes())?;
        }
        for [r, g, b] in &self.colours {
            to.write_all(&[*r, *g, *b, 255])?;
        }
        for i in self.triangles.iter().flatten() {
            to.write_all(&i.to_le_bytes())?;
        }
        Ok(())
    }

    fn json(&self, sizes: [usize; 4], up: Option<&Vec3>) -> String {
        let mut at = 0;
        let views: Vec<String> = sizes
            .iter()
            .zip([34962, 34962, 34962, 34963])
            .map(|(size, target)| {
                at += size;
                format!(
                    r#"{{"buffer":0,"byteOffset":{},"byteLength":{size},"target":{target}}}"#,
                    at - size
                )
            })
            .collect();
        let (corners, [least, most]) = (self.positions.len(), self.bounds());
        let turn = UnitQuaternion::rotation_between(up.unwrap_or(&-Vec3::y()), &Vec3::y())
            .unwrap_or_else(|| {
                UnitQuaternion::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI)
            });
        let [x, y, z, w] = <[f64; 4]>::from(turn.coords);
        // glTF forbids empty meshes: writes a scene without nodes.
        if self.triangles.is_empty() {
            return r#"{"asset":{"version":"2.0","generator":"Stillpoint"},"scene":0,"scenes":[{}]}"#.to_owned();
        }
        let accessor = |view: usize, kind: u32, count: usize, shape: &str, more: &str| {
            format!(
                r#"{{"bufferView":{view},"componentType":{kind},"count":{count},"type":"{shape}"{more}}}"#
            )
        };
        let accessors = [
            accessor(
                0,
                5126,
                corners,
                "VEC3",
                &format!(r#","min":{least:?},"max":{most:?}"#),
            ),
            accessor(1, 5126, corners, "VEC3", ""),
            accessor(2, 5121, corners, "VEC4", r#","normalized":true"#),
            accessor(3, 5125, 3 * self.triangles.len(), "SCALAR", ""),
        ];
        format!(
            r#"{{"asset":{{"version":"2.0","generator":"Stillpoint"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"rotation":[{x},{y},{z},{w}]}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"COLOR_0":2}},"indices":3,"material":0}}]}}],"materials":[{{"pbrMetallicRoughness":{{"metallicFactor":0,"roughnessFactor":1}},"doubleSided":true}}],"accessors":[{}],"bufferViews":[{}],"buffers":[{{"byteLength":{at}}}]}}"#,
            accessors.join(","),
            views.join(",")
        )
    }

    fn bounds(&self) -> [[f32; 3]; 2] {
        let first = self.positions.first().copied().unwrap_or_default();
        self.positions.iter().fold([first; 2], |[least, most], p| {
            [
                std::array::from_fn(|i| least[i].min(p[i])),
                std::array::from_fn(|i| most[i].max(p[i])),
            ]
        })
    }
}
