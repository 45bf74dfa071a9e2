//! Scans: a closed OBJ mesh, convex OBJ groups and a mass, as an [`ObjectInstance`].

use super::foot::feet;
use super::hollow::{self, Hollow};
use super::instance::{Interior, ObjectInstance, Part, Surface};
use super::piece::{LabelledPiece, Piece, Touches, floor_disk, stave_walls};
use crate::GeometryError;
use crate::mesh::TriMesh;
use nalgebra::{Point3, Vector3};
use parry3d::query::PointQuery;
use parry3d::shape::TriMeshFlags;
use sfg_types::Pose;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// What a scan consists of.
#[derive(Clone, Debug, PartialEq)]
pub struct ScannedObject {
    /// Name of the category.
    pub category: String,
    /// Other words for it.
    pub words: Vec<String>,
    /// Closed triangle mesh, metres, +Z up.
    pub mesh: PathBuf,
    /// Convex groups (`o NAME`), in the frame of the mesh.
    pub hulls: PathBuf,
    /// Mass.
    pub mass_kg: f64,
    /// How a closed scan is made a vessel; as it is when absent.
    pub hollow: Option<Hollow>,
    /// Red, green, blue.
    pub colour: [u8; 3],
}

impl ScannedObject {
    /// The object with its origin moved to the centre of the base footprint. Its single part is called `body`.
    ///
    /// Vessels (round inside and hollow from above) get cuboid staves and a cylinder floor as walls, so that they hold grains;
    /// walls thinner than 3 mm are thickened outwards. Of the convex groups only those outside the wall, such as a handle, are
    /// then kept. Everything else is its convex groups, and a flat foot inside the base of those that stand.
    ///
    /// With [`ScannedObject::hollow`] a closed scan is cut off and bored. Surface, distances and the spread of the mass are those of
    /// the bored solid. Grains meet round walls of staves and nothing else; everything but grains meets the convex groups, cut at
    /// the mouth. So a finger or a thing that would reach through the mouth stops there as if it were closed, and grains outside
    /// pass through what a flat bottle has beyond its round wall.
    ///
    /// # Errors
    /// [`GeometryError::Io`] for a missing file, [`GeometryError::BadMesh`] with file and line for text that is no OBJ, for a mesh
    /// that is not closed, and for a `hollow` that the scan has no room for or that it has already.
    pub fn load(&self) -> Result<ObjectInstance, GeometryError> {
        let mesh = TriMesh::read_obj(&self.mesh)?;
        let groups = TriMesh::read_obj_groups(&self.hulls)?;
        let shift = Pose::from_parts((-base_centre(&mesh).coords).into(), nalgebra::UnitQuaternion::identity());
        let mesh = mesh.transformed(&shift);
        let scan = MeshDistance::new(mesh, &self.mesh)?;
        let groups: Vec<TriMesh> = groups.into_iter().map(|(_, group)| group.transformed(&shift)).collect();
        let (scan, pieces, interior) = match &self.hollow {
            Some(hollow) => self.bored(&scan, &groups, hollow)?,
            None => {
                let (pieces, interior) = as_scanned(&scan, &groups);
                (scan, pieces, interior)
            }
        };
        Ok(ObjectInstance::new(
            self.category.clone(),
            self.words.clone(),
            vec![Part { label: "body".to_owned(), colour: self.colour }],
            pieces,
            interior,
            Surface::Mesh(Box::new(scan)),
            self.mass_kg,
        ))
    }

    fn bored(
        &self,
        scan: &MeshDistance,
        groups: &[TriMesh],
        hollow: &Hollow,
    ) -> Result<(MeshDistance, Vec<LabelledPiece>, Option<Interior>), GeometryError> {
        let bad =
            |message: String| GeometryError::BadMesh { file: self.mesh.clone(), line: 0, message: format!("hollow: {message}") };
        if fit_vessel(scan).is_some() {
            return Err(bad("the scan is hollow already: it holds grains as it is".to_owned()));
        }
        let (mesh, vessel) = hollow::bore(scan, hollow).map_err(bad)?;
        let mut pieces = vessel.pieces(Touches::GrainsOnly);
        let hulls = groups.iter().filter_map(|group| hollow::cut_hull(group, hollow.mouth_m));
        let hulls = hulls.chain(feet(groups));
        pieces.extend(hulls.map(|hull| LabelledPiece { touches: Touches::AllButGrains, ..hull }));
        Ok((MeshDistance::new(mesh, &self.mesh)?, pieces, Some(vessel.interior())))
    }
}

/// Pieces and hollow of a scan that is left as it is.
fn as_scanned(scan: &MeshDistance, groups: &[TriMesh]) -> (Vec<LabelledPiece>, Option<Interior>) {
    let hulls = groups.iter().map(|group| hull_piece(&group.vertices));
    match fit_vessel(scan) {
        None => (hulls.chain(feet(groups)).collect(), None),
        Some(vessel) => {
            let outside = hulls.filter(|hull| vessel.is_outside(&hull.object_from_piece.translation.vector));
            let mut pieces = vessel.pieces(Touches::Everything);
            pieces.extend(outside);
            (pieces, Some(vessel.interior()))
        }
    }
}

/// Signed distance to a closed triangle mesh.
#[derive(Clone)]
pub(crate) struct MeshDistance {
    mesh: TriMesh,
    query: parry3d::shape::TriMesh,
}

impl std::fmt::Debug for MeshDistance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "MeshDistance({} triangles)", self.mesh.triangles.len())
    }
}

impl MeshDistance {
    fn new(mesh: TriMesh, file: &Path) -> Result<Self, GeometryError> {
        let bad = |message: String| GeometryError::BadMesh { file: file.to_owned(), line: 0, message };
        let n_open = mesh.n_open_edges();
        if n_open > 0 {
            return Err(bad(format!("the mesh is not closed: {n_open} edges do not join two triangles")));
        }
        let vertices = mesh.vertices.iter().map(to_parry).collect();
        let query = parry3d::shape::TriMesh::with_flags(vertices, mesh.triangles.clone(), TriMeshFlags::ORIENTED)
            .map_err(|error| bad(error.to_string()))?;
        Ok(Self { mesh, query })
    }

    pub(crate) fn mesh(&self) -> &TriMesh {
        &self.mesh
    }

    pub(crate) fn signed_distance(&self, p: &Point3<f64>) -> f64 {
        let point = to_parry(p);
        let projection = self.query.project_local_point(point, false);
        let distance = f64::from((projection.point - point).length());
        if projection.is_inside { -distance } else { distance }
    }
}

fn to_parry(p: &Point3<f64>) -> parry3d::math::Vector {
    parry3d::math::Vector::new(p.x as f32, p.y as f32, p.z as f32)
}

/// Lowest height and middle of the lowest tenth: where the object stands.
fn base_centre(mesh: &TriMesh) -> Point3<f64> {
    let Some((low, high)) = mesh.bounds() else { return Point3::origin() };
    let limit = low.z + (high.z - low.z) / 10.0;
    let mut footprint = mesh.vertices.iter().filter(|v| v.z <= limit);
    let first = footprint.next().copied().unwrap_or(low);
    let (a, b) = footprint.fold((first, first), |(a, b), v| (a.inf(v), b.sup(v)));
    Point3::new((a.x + b.x) / 2.0, (a.y + b.y) / 2.0, low.z)
}

/// The hull of `points`, about their middle: single precision collision code is best near its origin.
pub(super) fn hull_piece(points: &[Point3<f64>]) -> LabelledPiece {
    let sum: Vector3<f64> = points.iter().map(|v| v.coords).sum();
    let centroid = sum / points.len().max(1) as f64;
    LabelledPiece {
        piece: Piece::ConvexHull { points: points.iter().map(|v| v - centroid).collect() },
        object_from_piece: Pose::translation(centroid.x, centroid.y, centroid.z),
        part_idx: 0,
        touches: Touches::Everything,
    }
}

/// The round wall of a vessel about the vertical axis through `axis`.
pub(super) struct Vessel {
    pub(super) axis: [f64; 2],
    /// `[radius, height]` inside, from the floor up.
    pub(super) inner: Vec<[f64; 2]>,
    /// The same outside, point for point.
    pub(super) outer: Vec<[f64; 2]>,
    pub(super) wall: f64,
    pub(super) floor_radius: f64,
}

/// Finds the wall of a hollow that is round and open at the top; `None` for everything else.
fn fit_vessel(scan: &MeshDistance) -> Option<Vessel> {
    const N_AROUND: usize = 24;
    const N_LEVELS: usize = 10;
    /// Scans of round things scatter by this much.
    const ROUND_M: f64 = 2.5e-3;
    let (low, high) = scan.mesh.bounds()?;
    let mut axis = [0.0, 0.0];
    // The axis is the middle of the inner wall: twice from the wall seen from the present guess.
    for _ in 0..3 {
        let z = low.z + 0.7 * (high.z - low.z);
        let start = Point3::new(axis[0], axis[1], z);
        let hits: Vec<[f64; 2]> = (0..N_AROUND)
            .map(|i| {
                let (sin, cos) = (TAU * i as f64 / N_AROUND as f64).sin_cos();
                wall_along(scan, &start, &Vector3::new(cos, sin, 0.0))
                    .map(|(inner, _)| [axis[0] + cos * inner, axis[1] + sin * inner])
            })
            .collect::<Option<_>>()?;
        axis = [0, 1].map(|k| hits.iter().map(|h| h[k]).sum::<f64>() / N_AROUND as f64);
    }
    // The floor, from above along the axis.
    let top = Point3::new(axis[0], axis[1], high.z + 0.01);
    let (to_floor, _) = wall_along(scan, &top, &-Vector3::z())?;
    let floor = top.z - to_floor;
    let rim = high.z - 1e-3;
    if rim - floor < 0.3 * (high.z - low.z) {
        return None;
    }
    let mut inner = Vec::new();
    let mut walls = Vec::new();
    for level in 0..N_LEVELS {
        let t = (level as f64 + 0.3) / (N_LEVELS as f64 - 0.4);
        let start = Point3::new(axis[0], axis[1], floor + (rim - floor) * t.min(1.0));
        let mut hits: Vec<(f64, f64)> = (0..N_AROUND)
            .filter_map(|i| {
                let (sin, cos) = (TAU * i as f64 / N_AROUND as f64).sin_cos();
                wall_along(scan, &start, &Vector3::new(cos, sin, 0.0))
            })
            .collect();
        // An uneven rim may be missing on one side; elsewhere the wall must be all around.
        if hits.len() < N_AROUND * 3 / 4 {
            if level + 1 == N_LEVELS {
                break;
            }
            return None;
        }
        hits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let middle = hits[hits.len() / 2].0;
        let n_round = hits.iter().filter(|h| (h.0 - middle).abs() <= ROUND_M).count();
        if n_round * 10 < hits.len() * 9 {
            return None;
        }
        let mut thickness: Vec<f64> = hits.iter().map(|h| h.1 - h.0).collect();
        thickness.sort_by(f64::total_cmp);
        walls.push(thickness[thickness.len() / 2]);
        inner.push([middle, start.z]);
    }
    walls.sort_by(f64::total_cmp);
    let wall = walls[walls.len() / 2].clamp(3e-3, 8e-3);
    // The rim itself: go on in the direction of the last two levels.
    let (p, q) = (inner[inner.len() - 2], inner[inner.len() - 1]);
    let slope = (q[0] - p[0]) / (q[1] - p[1]);
    inner.push([q[0] + slope * (high.z - q[1]), high.z]);
    inner.insert(0, [(inner[0][0] - slope_at(&inner) * (inner[0][1] - floor)).max(0.3 * inner[0][0]), floor]);
    let outer: Vec<[f64; 2]> = offset_outwards(&inner, wall);
    Some(Vessel { axis, floor_radius: outer[0][0], inner, outer, wall })
}

fn slope_at(inner: &[[f64; 2]]) -> f64 {
    (inner[1][0] - inner[0][0]) / (inner[1][1] - inner[0][1])
}

/// Every point moved outwards by the wall along the mean normal of its neighbours.
pub(super) fn offset_outwards(inner: &[[f64; 2]], wall: f64) -> Vec<[f64; 2]> {
    (0..inner.len())
        .map(|i| {
            let (p, q) = (inner[i.saturating_sub(1)], inner[(i + 1).min(inner.len() - 1)]);
            let length = (q[0] - p[0]).hypot(q[1] - p[1]);
            [inner[i][0] + (q[1] - p[1]) / length * wall, inner[i][1] - (q[0] - p[0]) / length * wall]
        })
        .collect()
}

/// Where a ray from free space enters the solid and leaves it again; `None` when it meets nothing within 0.5 m.
fn wall_along(scan: &MeshDistance, start: &Point3<f64>, direction: &Vector3<f64>) -> Option<(f64, f64)> {
    const TOUCH_M: f64 = 5e-5;
    let mut s = 0.0;
    let mut entry = None;
    while s < 0.5 {
        let d = scan.signed_distance(&(start + direction * s));
        match entry {
            None if s == 0.0 && d < 0.0 => return None,
            None if d < TOUCH_M => {
                entry = Some(s);
                s += 4.0 * TOUCH_M;
            }
            Some(inner) if d > TOUCH_M => return Some((inner, s)),
            _ => s += d.abs().max(TOUCH_M),
        }
    }
    None
}

impl Vessel {
    fn pieces(&self, touches: Touches) -> Vec<LabelledPiece> {
        let floor = self.inner[0][1];
        let mut pieces = vec![floor_disk(self.floor_radius, floor - self.wall, floor)];
        pieces.extend(stave_walls(&self.outer, self.wall));
        pieces
            .into_iter()
            .map(|(piece, pose)| LabelledPiece {
                piece,
                object_from_piece: Pose::translation(self.axis[0], self.axis[1], 0.0) * pose,
                part_idx: 0,
                touches,
            })
            .collect()
    }

    fn interior(&self) -> Interior {
        Interior::new(self.axis, self.inner.iter().map(|[r, z]| [*z, *r]).collect())
    }

    fn is_outside(&self, centroid: &Vector3<f64>) -> bool {
        let radius = (centroid.x - self.axis[0]).hypot(centroid.y - self.axis[1]);
        let wall_here = self
            .outer
            .windows(2)
            .find(|w| (w[0][1]..=w[1][1]).contains(&centroid.z))
            .map_or(self.outer[0][0], |w| w[0][0].max(w[1][0]));
        radius > wall_here + 2e-3 && centroid.z > 0.0
    }
}
