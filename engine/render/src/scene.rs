//! What is drawn and what comes out.

use crate::raster;
use nalgebra::{Point3, Vector3};
use sfg_geometry::TriMesh;
use sfg_types::{CameraIntrinsics, Pose, RgbdImage};

/// Identity of pixels that show nothing.
pub const NO_ID: u16 = u16::MAX;

/// Neighbouring triangles that meet at less than this shade as one smooth surface.
const CREASE_RAD: f64 = 0.6;

/// A mesh prepared for drawing: made once, drawn many times.
#[derive(Clone, Debug)]
pub struct RenderMesh {
    pub(crate) vertices: Vec<Point3<f64>>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) colours: Vec<[u8; 3]>,
    pub(crate) normals: Vec<[Vector3<f32>; 3]>,
    /// Triangles seen from behind can be left out when the mesh is closed.
    pub(crate) closed: bool,
}

/// How a surface takes its colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Finish {
    /// One colour.
    #[default]
    Plain,
    /// A faint grain along the mesh's x axis, so that a table does not look like empty space.
    Wood,
    /// Faint squares of 0.25 m in the mesh's xy plane, for floors.
    Tiles,
}

/// One mesh in the scene.
#[derive(Clone, Copy, Debug)]
pub struct Item<'a> {
    /// The mesh.
    pub mesh: &'a RenderMesh,
    /// Where it is.
    pub base_from_mesh: Pose,
    /// Colour of meshes without colours of their own.
    pub colour: [u8; 3],
    /// Surface.
    pub finish: Finish,
    /// Written to [`Frame::instance_ids`].
    pub instance_id: u16,
    /// Written to [`Frame::part_ids`].
    pub part_id: u16,
}

/// One ball in the scene: grains, markers. Drawn exactly, without triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub centre_in_base: Point3<f64>,
    /// Radius.
    pub radius_m: f64,
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// Written to [`Frame::instance_ids`].
    pub instance_id: u16,
    /// Written to [`Frame::part_ids`].
    pub part_id: u16,
}

/// Everything that can be seen.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// Meshes.
    pub items: Vec<Item<'a>>,
    /// Balls.
    pub spheres: Vec<Sphere>,
    /// Colour of pixels that show nothing.
    pub background: [u8; 3],
}

impl Default for Scene<'_> {
    fn default() -> Self {
        Self { items: Vec::new(), spheres: Vec::new(), background: [214, 219, 226] }
    }
}

/// One rendered view.
///
/// | field | shape | unit |
/// |---|---|---|
/// | `rgb` | `height * width * 3`, row-major | 0-255 |
/// | `depth_m` | `height * width` | m along the camera's +Z; 0 = nothing |
/// | `instance_ids`, `part_ids` | `height * width` | as given; [`NO_ID`] = nothing |
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Colours.
    pub rgb: Vec<u8>,
    /// Exact depth.
    pub depth_m: Vec<f32>,
    /// What each pixel shows.
    pub instance_ids: Vec<u16>,
    /// Which part of it.
    pub part_ids: Vec<u16>,
}

impl RenderMesh {
    /// Prepares a mesh; its own colours, when it has some, win over [`Item::colour`].
    #[must_use]
    pub fn new(mesh: &TriMesh) -> Self {
        let normals = mesh.corner_normals(CREASE_RAD).into_iter().map(|n| n.map(|v| v.cast::<f32>())).collect();
        Self {
            vertices: mesh.vertices.clone(),
            triangles: mesh.triangles.clone(),
            colours: mesh.colours.clone(),
            normals,
            closed: mesh.n_open_edges() == 0 && mesh.volume_m3() > 0.0,
        }
    }

    /// How many triangles it has.
    #[must_use]
    pub fn n_triangles(&self) -> usize {
        self.triangles.len()
    }
}

/// Draws a scene as a pinhole camera sees it: one sample at each pixel centre, exact depth, the nearest surface wins.
///
/// Light is ambient plus two fixed directional lights in the base frame, Lambert, without shadows. Surfaces nearer than 1 cm are
/// cut. The same scene gives the same bytes at any thread count.
#[must_use]
pub fn render(scene: &Scene<'_>, intrinsics: &CameraIntrinsics, base_from_camera: &Pose) -> Frame {
    raster::render(scene, intrinsics, base_from_camera)
}

/// As [`render`] with colours averaged over 2 x 2 samples a pixel, for pictures that people look at. Depth and identities are
/// those of one sample.
#[must_use]
pub fn render_smooth(scene: &Scene<'_>, intrinsics: &CameraIntrinsics, base_from_camera: &Pose) -> Frame {
    let camera = *intrinsics;
    let fine = CameraIntrinsics {
        width: camera.width * 2,
        height: camera.height * 2,
        fx: camera.fx * 2.0,
        fy: camera.fy * 2.0,
        cx: camera.cx * 2.0 + 0.5,
        cy: camera.cy * 2.0 + 0.5,
    };
    let big = raster::render(scene, &fine, base_from_camera);
    let pixels = || (0..camera.height).flat_map(|row| (0..camera.width).map(move |column| (row, column)));
    let at = |row: usize, column: usize| row * big.width + column;
    let mut rgb = Vec::with_capacity(camera.width * camera.height * 3);
    for (row, column) in pixels() {
        let quad = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(r, c)| at(2 * row + r, 2 * column + c));
        for channel in 0..3 {
            let sum: u16 = quad.iter().map(|&idx| u16::from(big.rgb[idx * 3 + channel])).sum();
            rgb.push(((sum + 2) / 4) as u8);
        }
    }
    Frame {
        width: camera.width,
        height: camera.height,
        rgb,
        depth_m: pixels().map(|(r, c)| big.depth_m[at(2 * r, 2 * c)]).collect(),
        instance_ids: pixels().map(|(r, c)| big.instance_ids[at(2 * r, 2 * c)]).collect(),
        part_ids: pixels().map(|(r, c)| big.part_ids[at(2 * r, 2 * c)]).collect(),
    }
}

impl Frame {
    /// The frame as a camera named `camera` would deliver it.
    #[must_use]
    pub fn into_rgbd(self, camera: &str, intrinsics: &CameraIntrinsics, base_from_camera: &Pose) -> RgbdImage {
        RgbdImage {
            camera: camera.to_owned(),
            intrinsics: *intrinsics,
            base_from_camera: *base_from_camera,
            rgb: self.rgb,
            depth_m: self.depth_m,
        }
    }

    /// 1 where the pixel shows the instance (and, when given, that part of it), 0 elsewhere.
    #[must_use]
    pub fn mask_of(&self, instance_id: u16, part_id: Option<u16>) -> Vec<u8> {
        self.instance_ids
            .iter()
            .zip(&self.part_ids)
            .map(|(&instance, &part)| u8::from(instance == instance_id && part_id.is_none_or(|wanted| wanted == part)))
            .collect()
    }
}
