//! Triangle meshes: measures, OBJ text, primitives, and the surface of a signed distance field.

mod marching;
mod obj;
mod primitives;

pub use marching::surface_of;
pub use primitives::{capsule, convex_hull, cuboid, cylinder, revolve, sphere, tube};

use nalgebra::{Point3, Vector3};
use sfg_types::Pose;
use std::collections::HashMap;

/// A triangle mesh in metres; counter-clockwise triangles seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Corners.
    pub vertices: Vec<Point3<f64>>,
    /// Three vertex indices each.
    pub triangles: Vec<[u32; 3]>,
    /// Red, green, blue: empty, or one for each triangle.
    pub colours: Vec<[u8; 3]>,
}

impl TriMesh {
    /// A mesh without colours.
    #[must_use]
    pub fn new(vertices: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Self {
        Self { vertices, triangles, colours: Vec::new() }
    }

    /// The three corners of triangle `idx`.
    #[must_use]
    pub fn corners(&self, idx: usize) -> [Point3<f64>; 3] {
        self.triangles[idx].map(|v| self.vertices[v as usize])
    }

    /// Cross product of two sides: twice the area, along the outward normal.
    #[must_use]
    pub fn area_vector(&self, idx: usize) -> Vector3<f64> {
        let [a, b, c] = self.corners(idx);
        (b - a).cross(&(c - a))
    }

    /// The mesh moved by `pose`.
    #[must_use]
    pub fn transformed(mut self, pose: &Pose) -> Self {
        for vertex in &mut self.vertices {
            *vertex = pose * *vertex;
        }
        self
    }

    /// The mesh with one colour for all triangles.
    #[must_use]
    pub fn coloured(mut self, colour: [u8; 3]) -> Self {
        self.colours = vec![colour; self.triangles.len()];
        self
    }

    /// Adds the triangles of `other`. Missing colours become middle grey once either side has some.
    pub fn append(&mut self, other: &Self) {
        const GREY: [u8; 3] = [128; 3];
        if !(self.colours.is_empty() && other.colours.is_empty()) {
            self.colours.resize(self.triangles.len(), GREY);
            self.colours.extend_from_slice(&other.colours);
        }
        let offset = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + offset)));
        if !self.colours.is_empty() {
            self.colours.resize(self.triangles.len(), GREY);
        }
    }

    /// Smallest and largest coordinates; `None` without vertices.
    #[must_use]
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        let first = *self.vertices.first()?;
        Some(self.vertices.iter().fold((first, first), |(low, high), v| (low.inf(v), high.sup(v))))
    }

    /// Enclosed volume, cubic metres; meaningful for closed meshes, negative when turned inside out.
    #[must_use]
    pub fn volume_m3(&self) -> f64 {
        (0..self.triangles.len())
            .map(|idx| {
                let [a, b, c] = self.corners(idx);
                a.coords.dot(&b.coords.cross(&c.coords)) / 6.0
            })
            .sum()
    }

    /// Surface area, square metres.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        (0..self.triangles.len()).map(|idx| self.area_vector(idx).norm() / 2.0).sum()
    }

    /// How many edges are not shared by exactly two triangles that run along them in opposite directions; 0 = closed.
    #[must_use]
    pub fn n_open_edges(&self) -> usize {
        // Forward runs count up, backward runs down, so a closed edge ends as (2 uses, sum 0).
        let mut uses: HashMap<(u32, u32), (u32, i32)> = HashMap::with_capacity(self.triangles.len() * 3 / 2);
        for t in &self.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let entry = uses.entry((a.min(b), a.max(b))).or_default();
                entry.0 += 1;
                entry.1 += if a < b { 1 } else { -1 };
            }
        }
        uses.values().filter(|&&(n, sum)| n != 2 || sum != 0).count()
    }

    /// Vertices - edges + faces: 2 for each closed ball-like body, 0 for each ring-like one.
    #[must_use]
    pub fn euler_characteristic(&self) -> i64 {
        let mut edges: Vec<(u32, u32)> = self
            .triangles
            .iter()
            .flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])].map(|(a, b)| (a.min(b), a.max(b))))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        self.vertices.len() as i64 - edges.len() as i64 + self.triangles.len() as i64
    }

    /// A unit normal for each corner of each triangle: the mean over the neighbours that meet at less than `crease_rad`, weighted
    /// by area, so that round walls shade smoothly and edges stay sharp. Vertices at equal positions count as one.
    #[must_use]
    pub fn corner_normals(&self, crease_rad: f64) -> Vec<[Vector3<f64>; 3]> {
        let weld = self.welded_indices();
        let areas: Vec<Vector3<f64>> = (0..self.triangles.len()).map(|idx| self.area_vector(idx)).collect();
        let units: Vec<Vector3<f64>> = areas.iter().map(|n| n.try_normalize(1e-18).unwrap_or_else(Vector3::zeros)).collect();
        let mut around: Vec<Vec<u32>> = vec![Vec::new(); self.vertices.len()];
        for (idx, t) in self.triangles.iter().enumerate() {
            for v in t {
                around[weld[*v as usize] as usize].push(idx as u32);
            }
        }
        let cos_crease = crease_rad.cos();
        (0..self.triangles.len())
            .map(|idx| {
                self.triangles[idx].map(|v| {
                    let sum: Vector3<f64> = around[weld[v as usize] as usize]
                        .iter()
                        .filter(|&&other| units[other as usize].dot(&units[idx]) >= cos_crease)
                        .map(|&other| areas[other as usize])
                        .sum();
                    sum.try_normalize(1e-18).unwrap_or(units[idx])
                })
            })
            .collect()
    }

    /// For each vertex the first one at the same position (to a micrometre).
    fn welded_indices(&self) -> Vec<u32> {
        let mut first: HashMap<[i64; 3], u32> = HashMap::with_capacity(self.vertices.len());
        self.vertices
            .iter()
            .enumerate()
            .map(|(idx, v)| *first.entry([v.x, v.y, v.z].map(|x| (x * 1e6).round() as i64)).or_insert(idx as u32))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_closed(mesh: &TriMesh, volume_m3: f64, euler: i64) {
        assert_eq!(mesh.n_open_edges(), 0, "open edges");
        assert_eq!(mesh.euler_characteristic(), euler, "Euler characteristic");
        let error = (mesh.volume_m3() / volume_m3 - 1.0).abs();
        assert!(error < 0.02, "volume {} m^3 instead of {volume_m3}", mesh.volume_m3());
    }

    #[test]
    fn primitives_are_closed_and_have_their_volume() {
        use std::f64::consts::PI;
        check_closed(&cuboid(&Vector3::new(0.1, 0.2, 0.3)), 8.0 * 0.1 * 0.2 * 0.3, 2);
        check_closed(&sphere(0.1, 48), 4.0 / 3.0 * PI * 1e-3, 2);
        check_closed(&cylinder(0.1, 0.05, 64), PI * 0.05_f64.powi(2) * 0.2, 2);
        check_closed(&capsule(0.1, 0.05, 64), PI * 0.05_f64.powi(2) * 0.2 + 4.0 / 3.0 * PI * 0.05_f64.powi(3), 2);
        let ring: Vec<_> = (0..64)
            .map(|i| {
                let angle = f64::from(i) * PI / 32.0;
                Point3::new(0.1 * angle.cos(), 0.1 * angle.sin(), 0.0)
            })
            .collect();
        check_closed(&tube(&ring, 0.01, true, 24), 2.0 * PI * 0.1 * PI * 1e-4, 0);
    }

    #[test]
    fn an_opened_box_has_open_edges() {
        let mut mesh = cuboid(&Vector3::repeat(1.0));
        mesh.triangles.pop();
        assert_eq!(mesh.n_open_edges(), 3);
    }

    #[test]
    fn sharp_edges_stay_sharp_and_round_walls_are_smooth() {
        let mesh = cylinder(0.1, 0.05, 32);
        for (idx, corners) in mesh.corner_normals(0.7).iter().enumerate() {
            for (normal, corner) in corners.iter().zip(mesh.corners(idx)) {
                let on_lid = normal.z.abs() > 0.999;
                let on_wall = normal.z.abs() < 1e-9 && normal.xy().dot(&corner.xy().coords) > 0.0499;
                assert!(on_lid || on_wall, "{normal:?} at {corner:?}");
            }
        }
    }
}
