//! Synthetic input of the suites: a hand and objects on a table, from formulas.

use crate::PoseRequest;
use sfg_types::tsdf::{EDGE, TRUNCATION_M, VOXEL_M};
use sfg_types::{
    GraspClass, GraspType, GraspTypeProfile, HandJoint, HandProfile, HandSide, Point, SynergyCoordinates, TaskKeyPoint, Tsdf,
};

/// Height of the table in every scene, metres.
pub(super) const TABLE_HEIGHT_M: f64 = 0.75;

/// A hand with one joint a finger, enough for code that reads a profile and no URDF. Tests of a generator for a real hand load
/// that hand's profile instead.
#[must_use]
pub fn hand_profile() -> HandProfile {
    let fingers = [("thumb", 2.0), ("index", 1.0), ("middle", 0.0), ("ring", -1.0), ("little", -2.0)];
    let joint = |(name, shifting_ratio): (&str, f64)| HandJoint {
        name: format!("{name}_joint"),
        lower_rad: 0.0,
        upper_rad: 1.5,
        stiffness_nm_per_rad: 0.3,
        damping_nms_per_rad: 0.01,
        closing_ratio: 1.0,
        shifting_ratio,
        max_torque_nm: 1.0,
    };
    let grasp_type = |kind: GraspType| {
        let (c1, standoff_min_m, standoff_max_m) = match kind.class() {
            GraspClass::Power => (0.9, 0.0, 0.01),
            GraspClass::Intermediate => (0.6, 0.02, 0.04),
            GraspClass::Precision => (0.5, 0.05, 0.065),
        };
        (kind, GraspTypeProfile { c_tar: SynergyCoordinates::new(c1, 0.1), standoff_min_m, standoff_max_m })
    };
    HandProfile {
        name: "five_joints".to_owned(),
        urdf_left: "left.urdf".to_owned(),
        urdf_right: "right.urdf".to_owned(),
        palm_link: "palm".to_owned(),
        joints: fingers.into_iter().map(joint).collect(),
        synergy_joints: fingers.iter().map(|(name, _)| format!("{name}_joint")).collect(),
        synergy_matrix: fingers.iter().map(|(_, shift)| [1.5, 0.2 * shift]).collect(),
        grasp_types: GraspType::ALL.into_iter().map(grasp_type).collect(),
        max_tension_nm: 2.0,
        tendon_stiffness_nm_per_rad: 4.0,
        max_current_amps: 1.0,
        max_closing_speed_per_sec: 1.0,
    }
}

/// An object in a TSDF with a part to hold.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseScene {
    /// The object.
    pub tsdf: Tsdf,
    /// The part to hold.
    pub affordance_region: Vec<u8>,
    /// Centre of the part.
    pub key_point: TaskKeyPoint,
}

impl PoseScene {
    /// An upright cylinder, 70 mm wide and 180 mm high, on the table; the part to hold is the middle third of its wall.
    #[must_use]
    pub fn cylinder() -> Self {
        let (radius, height) = (0.035, 0.18);
        let axis = [0.65, 0.10];
        let distance = |p: &Point| {
            let radial = (p.x - axis[0]).hypot(p.y - axis[1]) - radius;
            let vertical = (p.z - TABLE_HEIGHT_M - height / 2.0).abs() - height / 2.0;
            radial.max(0.0).hypot(vertical.max(0.0)) + radial.max(vertical).min(0.0)
        };
        let middle = TABLE_HEIGHT_M + height / 2.0;
        let on_wall = |p: &Point| (p.z - middle).abs() < height / 6.0 && (p.x - axis[0]).hypot(p.y - axis[1]) > radius - VOXEL_M;
        Self::from_distance(&Point::new(axis[0], axis[1], middle), distance, on_wall)
    }

    /// A ball, 70 mm wide, on the table; the part to hold is its upper half.
    #[must_use]
    pub fn ball() -> Self {
        let radius = 0.035;
        let centre = Point::new(0.60, -0.05, TABLE_HEIGHT_M + radius);
        Self::from_distance(&centre, |p| (p - centre).norm() - radius, |p| p.z > centre.z)
    }

    /// Nothing was seen: no voxel observed, no part, a key point in empty space.
    #[must_use]
    pub fn unobserved() -> Self {
        let centre = Point::new(0.65, 0.10, TABLE_HEIGHT_M + 0.1);
        Self {
            tsdf: Tsdf::unobserved(&centre),
            affordance_region: vec![0; EDGE * EDGE * EDGE],
            key_point: TaskKeyPoint { point_in_base: centre, part_points_in_base: Vec::new(), n_pixels: 0 },
        }
    }

    /// The question about this scene.
    #[must_use]
    pub fn request<'a>(&'a self, hand: &'a HandProfile, hand_side: HandSide, grasp_type: GraspType) -> PoseRequest<'a> {
        PoseRequest {
            tsdf: &self.tsdf,
            affordance_region: &self.affordance_region,
            key_point: &self.key_point,
            hand,
            hand_side,
            grasp_type,
            table_height_m: TABLE_HEIGHT_M,
        }
    }

    /// The grid around `centre`, fully observed by two views; the part is the surface within half a voxel where `on_part` holds.
    fn from_distance(centre: &Point, distance: impl Fn(&Point) -> f64, on_part: impl Fn(&Point) -> bool) -> Self {
        let mut scene = Self::unobserved();
        scene.tsdf = Tsdf::unobserved(centre);
        scene.tsdf.weights.fill(2.0);
        for (k, j, i) in (0..EDGE).flat_map(|k| (0..EDGE).flat_map(move |j| (0..EDGE).map(move |i| (k, j, i)))) {
            let point = scene.tsdf.centre_in_base(i, j, k);
            let distance_m = distance(&point);
            scene.tsdf.distances[Tsdf::index(i, j, k)] = (distance_m / TRUNCATION_M).clamp(-1.0, 1.0) as f32;
            if distance_m.abs() <= VOXEL_M / 2.0 && on_part(&point) {
                scene.affordance_region[Tsdf::index(i, j, k)] = 1;
                scene.key_point.part_points_in_base.push(point);
            }
        }
        scene.key_point.point_in_base = *centre;
        scene.key_point.n_pixels = scene.key_point.part_points_in_base.len();
        scene
    }
}
