//! One concrete object: distances, labels, meshes, collision pieces, mass, interior.

use super::mass::{MassProperties, integrate};
use super::piece::LabelledPiece;
use super::primitive::Primitive;
use super::scanned::MeshDistance;
use crate::mesh::{self, TriMesh};
use nalgebra::{Point3, Vector3};
use sfg_types::Pose;
use std::f64::consts::PI;

/// Edge of the smallest cell of the mass integration.
const MASS_LEAF_M: f64 = 2e-3;

/// One concrete object in its own frame: +Z up, origin at the centre of the base footprint.
#[derive(Clone, Debug)]
pub struct ObjectInstance {
    /// Name of the category: `mug`.
    pub category: String,
    /// Other words for it.
    pub words: Vec<String>,
    /// The labelled parts.
    pub parts: Vec<Part>,
    /// Collision pieces.
    pub pieces: Vec<LabelledPiece>,
    /// The hollow of a vessel.
    pub interior: Option<Interior>,
    /// How the mass is spread.
    pub mass: MassProperties,
    surface: Surface,
    low: Point3<f64>,
    high: Point3<f64>,
}

/// A named part of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Name: `handle`.
    pub label: String,
    /// Red, green, blue.
    pub colour: [u8; 3],
}

/// A part's mesh for pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplayMesh {
    /// Index into [`ObjectInstance::parts`].
    pub part_idx: usize,
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// Closed mesh in the object frame.
    pub mesh: TriMesh,
}

/// The hollow of a vessel: a body of revolution about an upright axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Interior {
    /// Where the axis meets the object's xy plane, metres.
    pub axis_xy_in_object: [f64; 2],
    /// `[height, inner radius]` in metres, rising from the floor to the rim.
    pub profile_m: Vec<[f64; 2]>,
}

#[derive(Clone, Debug)]
pub(crate) struct PlacedPrimitive {
    pub(crate) part_from_object: Pose,
    pub(crate) primitive: Primitive,
    pub(crate) relative_density: f64,
}

#[derive(Clone, Debug)]
pub(crate) enum Surface {
    /// One primitive a part, in the order of the parts.
    Parts(Vec<PlacedPrimitive>),
    /// A scan with a single part.
    Mesh(Box<MeshDistance>),
}

impl ObjectInstance {
    pub(crate) fn new(
        category: String,
        words: Vec<String>,
        parts: Vec<Part>,
        pieces: Vec<LabelledPiece>,
        interior: Option<Interior>,
        surface: Surface,
        mass_kg: f64,
    ) -> Self {
        let (low, high) = surface.bounds();
        let half_edge_m = (high - low).max() / 2.0 + 1e-3;
        let mass = integrate(
            &|p| surface.signed_distance(p),
            &|p| surface.relative_density(p),
            &nalgebra::center(&low, &high),
            half_edge_m,
            MASS_LEAF_M,
            mass_kg,
        );
        Self { category, words, parts, pieces, interior, mass, surface, low, high }
    }

    /// Distance of a point to the surface, metres, negative inside. Exact outside; where parts overlap, inside, a lower bound
    /// of the depth. Scans: to the triangle mesh, in single precision.
    #[must_use]
    pub fn signed_distance(&self, point_in_object: &Point3<f64>) -> f64 {
        self.surface.signed_distance(point_in_object)
    }

    /// Distance of a point to one part, metres, negative inside.
    #[must_use]
    pub fn signed_distance_to_part(&self, part_idx: usize, point_in_object: &Point3<f64>) -> f64 {
        match &self.surface {
            Surface::Parts(placed) => placed[part_idx].signed_distance(point_in_object),
            Surface::Mesh(mesh) => mesh.signed_distance(point_in_object),
        }
    }

    /// The unit gradient of the distance: the outward normal on the surface. Zero where it is undefined.
    #[must_use]
    pub fn normal_at(&self, point_in_object: &Point3<f64>) -> Vector3<f64> {
        const STEP_M: f64 = 2e-5;
        let slope = |axis: Vector3<f64>| {
            self.signed_distance(&(point_in_object + axis * STEP_M)) - self.signed_distance(&(point_in_object - axis * STEP_M))
        };
        Vector3::new(slope(Vector3::x()), slope(Vector3::y()), slope(Vector3::z()))
            .try_normalize(1e-12)
            .unwrap_or_else(Vector3::zeros)
    }

    /// Index of the part nearest to a point; of equals the first.
    #[must_use]
    pub fn part_at(&self, point_in_object: &Point3<f64>) -> usize {
        self.surface.part_at(point_in_object)
    }

    /// Label of the part nearest to a point.
    #[must_use]
    pub fn label_at(&self, point_in_object: &Point3<f64>) -> &str {
        &self.parts[self.part_at(point_in_object)].label
    }

    /// Corners of a box along the object's axes that holds it, metres.
    #[must_use]
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (self.low, self.high)
    }

    /// The surface of the union as one closed mesh; each triangle has the colour of its part. Scans return their own mesh and
    /// ignore the resolution.
    #[must_use]
    pub fn surface_mesh(&self, resolution_m: f64) -> TriMesh {
        let mut mesh = match &self.surface {
            Surface::Mesh(scan) => return scan.mesh().clone().coloured(self.parts[0].colour),
            Surface::Parts(_) => mesh::surface_of(&|p| self.signed_distance(p), &self.low, &self.high, resolution_m),
        };
        mesh.colours = (0..mesh.triangles.len())
            .map(|idx| {
                let [a, b, c] = mesh.corners(idx);
                self.parts[self.part_at(&Point3::from((a.coords + b.coords + c.coords) / 3.0))].colour
            })
            .collect();
        mesh
    }

    /// One light closed mesh a part, for pictures and simulated cameras.
    #[must_use]
    pub fn display_meshes(&self) -> Vec<DisplayMesh> {
        let colour = |part_idx: usize| self.parts[part_idx].colour;
        match &self.surface {
            Surface::Mesh(scan) => vec![DisplayMesh { part_idx: 0, colour: colour(0), mesh: scan.mesh().clone() }],
            Surface::Parts(placed) => placed
                .iter()
                .enumerate()
                .map(|(part_idx, placed)| DisplayMesh {
                    part_idx,
                    colour: colour(part_idx),
                    mesh: placed.primitive.display_mesh().transformed(&placed.part_from_object.inverse()),
                })
                .collect(),
        }
    }
}

impl Interior {
    pub(crate) fn new(axis_xy_in_object: [f64; 2], mut profile_m: Vec<[f64; 2]>) -> Self {
        // A floor of one height is said by its edge alone.
        profile_m.dedup_by(|next, previous| {
            let same = next[0] - previous[0] < 1e-6;
            if same {
                previous[1] = previous[1].max(next[1]);
            }
            same
        });
        Self { axis_xy_in_object, profile_m }
    }

    /// Height of the floor, metres.
    #[must_use]
    pub fn floor_m(&self) -> f64 {
        self.profile_m.first().map_or(0.0, |p| p[0])
    }

    /// Height of the rim, metres.
    #[must_use]
    pub fn rim_m(&self) -> f64 {
        self.profile_m.last().map_or(0.0, |p| p[0])
    }

    /// Radius of the opening at the rim, metres.
    #[must_use]
    pub fn opening_radius_m(&self) -> f64 {
        self.profile_m.last().map_or(0.0, |p| p[1])
    }

    /// Inner radius at a height; `None` below the floor or above the rim.
    #[must_use]
    pub fn radius_at(&self, height_m: f64) -> Option<f64> {
        self.profile_m.windows(2).find(|w| (w[0][0]..=w[1][0]).contains(&height_m)).map(|w| {
            let t = (height_m - w[0][0]) / (w[1][0] - w[0][0]);
            w[0][1] + t * (w[1][1] - w[0][1])
        })
    }

    /// Volume up to the rim, cubic metres.
    #[must_use]
    pub fn volume_m3(&self) -> f64 {
        let frustum = |[z0, r0]: [f64; 2], [z1, r1]: [f64; 2]| PI / 3.0 * (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1);
        self.profile_m.windows(2).map(|w| frustum(w[0], w[1])).sum()
    }

    /// Whether a point lies inside, at most to the rim.
    #[must_use]
    pub fn contains(&self, point_in_object: &Point3<f64>) -> bool {
        let [x, y] = self.axis_xy_in_object;
        self.radius_at(point_in_object.z).is_some_and(|r| (point_in_object.x - x).hypot(point_in_object.y - y) <= r)
    }

    /// Centres of at most `n` balls of the given radius that fit inside without touching, in layers from the floor; fewer when
    /// they would stand above the rim.
    #[must_use]
    pub fn grain_positions(&self, grain_radius_m: f64, n: usize) -> Vec<Point3<f64>> {
        // A hexagonal layer, every second one shifted into the gaps below; 2 % of air keeps physics from starting in contact.
        let pitch = 2.04 * grain_radius_m;
        let (row, layer) = (pitch * 3.0_f64.sqrt() / 2.0, pitch * (2.0_f64 / 3.0).sqrt());
        let mut out = Vec::with_capacity(n);
        for level in 0.. {
            let z = self.floor_m() + 1.1 * grain_radius_m + layer * f64::from(level);
            if z + grain_radius_m > self.rim_m() {
                break;
            }
            let (below, above) = (self.radius_at(z - grain_radius_m), self.radius_at(z + grain_radius_m));
            let reach = below.unwrap_or(0.0).min(above.unwrap_or(0.0)) - 1.15 * grain_radius_m;
            let shift = if level % 2 == 0 { 0.0 } else { pitch / 2.0 };
            let shift_y = if level % 2 == 0 { 0.0 } else { row / 3.0 };
            let n_side = (reach / row).ceil().max(0.0) as i32 + 1;
            for j in -n_side..=n_side {
                for i in -n_side - 1..=n_side + 1 {
                    let x = pitch * f64::from(i) + if j.rem_euclid(2) == 0 { 0.0 } else { pitch / 2.0 } + shift;
                    let y = row * f64::from(j) + shift_y;
                    if x.hypot(y) <= reach {
                        if out.len() == n {
                            return out;
                        }
                        out.push(Point3::new(self.axis_xy_in_object[0] + x, self.axis_xy_in_object[1] + y, z));
                    }
                }
            }
        }
        out
    }
}

impl PlacedPrimitive {
    fn signed_distance(&self, point_in_object: &Point3<f64>) -> f64 {
        self.primitive.signed_distance(&(self.part_from_object * point_in_object))
    }
}

impl Surface {
    fn signed_distance(&self, p: &Point3<f64>) -> f64 {
        match self {
            Self::Parts(placed) => placed.iter().map(|part| part.signed_distance(p)).fold(f64::INFINITY, f64::min),
            Self::Mesh(mesh) => mesh.signed_distance(p),
        }
    }

    fn part_at(&self, p: &Point3<f64>) -> usize {
        let Self::Parts(placed) = self else { return 0 };
        let mut best = (0, f64::INFINITY);
        for (idx, part) in placed.iter().enumerate() {
            let d = part.signed_distance(p);
            if d < best.1 {
                best = (idx, d);
            }
        }
        best.0
    }

    fn relative_density(&self, p: &Point3<f64>) -> f64 {
        match self {
            Self::Parts(placed) => placed[self.part_at(p)].relative_density,
            Self::Mesh(_) => 1.0,
        }
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let mut low = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut high = Point3::from(Vector3::repeat(f64::NEG_INFINITY));
        match self {
            Self::Mesh(mesh) => return mesh.mesh().bounds().unwrap_or_default(),
            Self::Parts(placed) => {
                for part in placed {
                    let (a, b) = part.primitive.bounds();
                    let object_from_part = part.part_from_object.inverse();
                    for corner in 0..8 {
                        let pick = |axis: usize| if corner >> axis & 1 == 1 { b[axis] } else { a[axis] };
                        let p = object_from_part * Point3::new(pick(0), pick(1), pick(2));
                        low = low.inf(&p);
                        high = high.sup(&p);
                    }
                }
            }
        }
        (low, high)
    }
}
