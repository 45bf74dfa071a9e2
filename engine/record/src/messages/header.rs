//! What stands at the beginning of a recording: robot, hand, cameras, table and objects.

use schemars::JsonSchema;
use serde::Serialize;
use sfg_types::layout::PoseLayout;
use sfg_types::{CameraIntrinsics, SynergyCoordinates};

/// `/run`: everything that viewers need to draw the rest. Once, at the start.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct RunHeader {
    /// Name of the scenario.
    pub scenario: String,
    /// What the user said.
    pub instruction: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Version of the engine.
    pub engine_version: String,
    /// The acting arm: `left` or `right`.
    pub arm: String,
    /// Links of the whole robot; a parent comes before its children.
    pub links: Vec<LinkHeader>,
    /// Names of the values of a configuration `q` of the whole robot.
    pub q_names: Vec<String>,
    /// Configuration at rest, radians.
    pub rest_q: Vec<f64>,
    /// Places in `q` of the acting arm's joints, in the order of `/robot`'s `q`.
    pub arm_q: Vec<usize>,
    /// Places in `q` of the acting hand's joints, in the order of the hand profile and of `/truth`'s `hand_q`.
    pub hand_q: Vec<usize>,
    /// Link of the acting palm.
    pub palm_link: String,
    /// The cameras.
    pub cameras: Vec<CameraHeader>,
    /// The hand's synergy plane.
    pub synergy: SynergyHeader,
    /// The table; none when nobody knows it.
    pub table: Option<TableHeader>,
    /// Objects of a simulated scene, for viewers alone.
    pub objects: Vec<ObjectHeader>,
    /// Radius of the grains; absent in older recordings, whose grains have 4 mm.
    pub grain_radius_m: f64,
}

/// One rigid body of the robot.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct LinkHeader {
    /// Name.
    pub name: String,
    /// Parent link, place in `links`; none for the base.
    pub parent: Option<usize>,
    /// The joint that holds it; none for the base.
    pub joint: Option<JointHeader>,
    /// What it looks like.
    pub shapes: Vec<ShapeHeader>,
}

/// One joint: `parent_from_link = origin * motion(value)`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct JointHeader {
    /// Name.
    pub name: String,
    /// `fixed`, `revolute` (radians about the axis) or `prismatic` (metres along it).
    pub kind: String,
    /// Pose in the parent at value 0.
    pub origin: PoseLayout,
    /// Axis in the joint's frame, unit length.
    pub axis: [f64; 3],
    /// Where its value comes from; none for fixed joints.
    pub source: Option<JointSourceHeader>,
}

/// `value = multiplier * q[q] + offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct JointSourceHeader {
    /// Place in the configuration of the whole robot.
    pub q: usize,
    /// 1 for a joint of its own.
    pub multiplier: f64,
    /// Radians or metres.
    pub offset: f64,
}

/// A shape fixed to a link.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ShapeHeader {
    /// `box`, `cylinder`, `sphere`, `capsule` or `mesh`.
    pub kind: String,
    /// Box: full extents x, y, z. Cylinder, capsule: radius, length along z (of a capsule without its round ends). Sphere: radius.
    /// Mesh: scale x, y, z. Metres.
    pub size: Vec<f64>,
    /// Pose in the link.
    pub origin: PoseLayout,
    /// Red, green, blue, 0 to 255.
    pub colour: [u8; 3],
    /// Name of the attachment that holds the mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
}

/// A calibrated camera; its frame has +Z forward, +X right, +Y down.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct CameraHeader {
    /// Name.
    pub name: String,
    /// Pinhole, pixels.
    pub intrinsics: CameraIntrinsics,
    /// Pose with the robot at rest.
    pub base_from_camera: PoseLayout,
}

/// The hand's synergy plane.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct SynergyHeader {
    /// Where each grasp type lies.
    pub grasp_types: Vec<GraspTypeHeader>,
    /// Joints that the matrix drives, without the side's prefix.
    pub joints: Vec<String>,
    /// `M`, one row `[m1, m2]` a joint.
    pub matrix: Vec<[f64; 2]>,
}

/// One grasp type of the hand.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct GraspTypeHeader {
    /// Name: `large_diameter`.
    pub name: String,
    /// Closing target.
    pub c_tar: SynergyCoordinates,
    /// Smallest distance of the palm from the object's surface, metres.
    pub standoff_min_m: f64,
    /// Largest one.
    pub standoff_max_m: f64,
}

/// The table's top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct TableHeader {
    /// Height above the floor.
    pub height_m: f64,
    /// Corner with the smallest x and y.
    pub low: [f64; 2],
    /// Corner with the largest.
    pub high: [f64; 2],
}

/// One object of a simulated scene.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ObjectHeader {
    /// Name in the scene.
    pub name: String,
    /// Category of its model.
    pub category: String,
    /// What it looks like, in its own frame.
    pub meshes: Vec<MeshHeader>,
}

/// A triangle mesh of one colour.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MeshHeader {
    /// Red, green, blue, 0 to 255.
    pub colour: [u8; 3],
    /// Base64 of 32-bit little-endian floats x, y, z, ..., metres.
    pub vertices: String,
    /// Base64 of 32-bit little-endian vertex numbers, three a triangle, counter-clockwise from outside.
    pub triangles: String,
}

impl MeshHeader {
    /// A mesh from vertices (metres) and triangles.
    pub fn new(
        colour: [u8; 3],
        vertices: impl IntoIterator<Item = [f64; 3]>,
        triangles: impl IntoIterator<Item = [u32; 3]>,
    ) -> Self {
        use base64::Engine as _;
        let encode = |bytes: Vec<u8>| base64::engine::general_purpose::STANDARD.encode(bytes);
        let vertices = vertices.into_iter().flatten().flat_map(|value| (value as f32).to_le_bytes()).collect();
        let triangles = triangles.into_iter().flatten().flat_map(u32::to_le_bytes).collect();
        Self { colour, vertices: encode(vertices), triangles: encode(triangles) }
    }

    /// Vertices and vertex numbers; empty when the text is no base64.
    pub(crate) fn decoded(&self) -> (Vec<[f64; 3]>, Vec<u32>) {
        use base64::Engine as _;
        let words = |text: &str| -> Vec<[u8; 4]> {
            let bytes = base64::engine::general_purpose::STANDARD.decode(text).unwrap_or_default();
            bytes.as_chunks::<4>().0.to_vec()
        };
        let numbers: Vec<f64> = words(&self.vertices).into_iter().map(|word| f64::from(f32::from_le_bytes(word))).collect();
        (numbers.as_chunks::<3>().0.to_vec(), words(&self.triangles).into_iter().map(u32::from_le_bytes).collect())
    }
}
