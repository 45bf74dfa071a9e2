//! What stands at the beginning of a recording: robot, hand, cameras, table, objects; and the files they come from.

use crate::run::RunRequest;
use sfg_driver_sim::world::{ObjectSpec, SceneSpec};
use sfg_kinematics::{Camera, Joint, JointKind, JointSource, Link, Primitive, RobotModel, Shape};
use sfg_record::messages::{
    CameraHeader, GraspTypeHeader, JointHeader, JointSourceHeader, LinkHeader, MeshHeader, ObjectHeader, RunHeader, ShapeHeader,
    SynergyHeader, TableHeader,
};
use sfg_types::{HandProfile, HandSide};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const ARM_COLOUR: [u8; 3] = [214, 214, 210];
const HAND_COLOUR: [u8; 3] = [62, 66, 72];

/// The first message of a run.
pub(super) fn header(request: &RunRequest<'_>, scene: &SceneSpec, profile: &HandProfile) -> RunHeader {
    let (model, side) = (request.model, request.scenario.arm);
    let arm = model.arm(side);
    let table = &scene.table;
    RunHeader {
        scenario: request.scenario.path().file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        instruction: request.instruction.as_str().to_owned(),
        seed: request.seed,
        engine_version: env!("CARGO_PKG_VERSION").to_owned(),
        arm: side.name().to_owned(),
        links: links(model),
        q_names: model.tree.q_names.clone(),
        rest_q: model.home_q.clone(),
        arm_q: arm.q_idx.clone(),
        hand_q: hand_q(model, side, profile),
        palm_link: arm.tip_link.clone(),
        cameras: cameras(model),
        synergy: synergy(profile),
        table: Some(TableHeader {
            height_m: table.height_m,
            low: [table.x_m[0], table.y_m[0]],
            high: [table.x_m[1], table.y_m[1]],
        }),
        objects: scene.objects.iter().map(object).collect(),
        grain_radius_m: scene.settings.grain_radius_m,
    }
}

/// Places in the robot's configuration of the hand's joints, in the order of the profile.
pub(super) fn hand_q(model: &RobotModel, side: HandSide, profile: &HandProfile) -> Vec<usize> {
    let prefix = format!("{}_", side.name());
    let place = |name: &str| model.tree.q_names.iter().position(|q| q == name || q.strip_prefix(&prefix) == Some(name));
    profile.joints.iter().filter_map(|joint| place(&joint.name)).collect()
}

fn links(model: &RobotModel) -> Vec<LinkHeader> {
    let tree = &model.tree;
    // Only the names of the links below a hand's root tell that they are a hand.
    let hands: Vec<&str> = [&model.left, &model.right].iter().filter_map(|arm| arm.hand_root_link.as_deref()).collect();
    let mut is_hand = vec![false; tree.links.len()];
    let mut headers = Vec::with_capacity(tree.links.len());
    for (idx, link) in tree.links.iter().enumerate() {
        let joint = link.joint_idx.and_then(|joint| tree.joints.get(joint));
        is_hand[idx] = hands.contains(&link.name.as_str()) || joint.is_some_and(|joint| is_hand[joint.parent_idx]);
        let colour = if is_hand[idx] { HAND_COLOUR } else { ARM_COLOUR };
        headers.push(LinkHeader {
            name: link.name.clone(),
            parent: joint.map(|joint| joint.parent_idx),
            joint: joint.map(joint_header),
            shapes: shapes(link, colour),
        });
    }
    headers
}

fn joint_header(joint: &Joint) -> JointHeader {
    JointHeader {
        name: joint.name.clone(),
        kind: match joint.kind {
            JointKind::Fixed => "fixed",
            JointKind::Revolute => "revolute",
            JointKind::Prismatic => "prismatic",
        }
        .to_owned(),
        origin: joint.parent_from_joint.into(),
        axis: joint.axis.into_inner().into(),
        source: match joint.source {
            JointSource::None => None,
            JointSource::Independent { q_idx } => Some(JointSourceHeader { q: q_idx, multiplier: 1.0, offset: 0.0 }),
            JointSource::Mimic { q_idx, multiplier, offset } => Some(JointSourceHeader { q: q_idx, multiplier, offset }),
        },
    }
}

fn shapes(link: &Link, colour: [u8; 3]) -> Vec<ShapeHeader> {
    let shape = |part: &Primitive| {
        let (kind, size, mesh) = match &part.shape {
            Shape::Cuboid { half_extents_m: half } => ("box", vec![2.0 * half.x, 2.0 * half.y, 2.0 * half.z], None),
            Shape::Sphere { radius_m } => ("sphere", vec![*radius_m], None),
            Shape::Cylinder { radius_m, half_length_m } => ("cylinder", vec![*radius_m, 2.0 * half_length_m], None),
            Shape::Capsule { radius_m, half_length_m } => ("capsule", vec![*radius_m, 2.0 * half_length_m], None),
            Shape::Mesh { file, scale } => ("mesh", vec![scale.x, scale.y, scale.z], Some(file.clone())),
        };
        ShapeHeader { kind: kind.to_owned(), size, origin: part.link_from_shape.into(), colour, mesh }
    };
    link.collision.iter().map(shape).collect()
}

fn cameras(model: &RobotModel) -> Vec<CameraHeader> {
    let poses = model.camera_poses(&model.home_q);
    let header = |(camera, pose): (&Camera, sfg_types::Pose)| CameraHeader {
        name: camera.name.clone(),
        intrinsics: camera.intrinsics,
        base_from_camera: pose.into(),
    };
    model.cameras.iter().zip(poses).map(header).collect()
}

fn synergy(profile: &HandProfile) -> SynergyHeader {
    let grasp_types = profile.grasp_types.iter().map(|(grasp_type, place)| GraspTypeHeader {
        name: grasp_type.name().to_owned(),
        c_tar: place.c_tar,
        standoff_min_m: place.standoff_min_m,
        standoff_max_m: place.standoff_max_m,
    });
    SynergyHeader {
        grasp_types: grasp_types.collect(),
        joints: profile.synergy_joints.clone(),
        matrix: profile.synergy_matrix.clone(),
    }
}

fn object(object: &ObjectSpec) -> ObjectHeader {
    let meshes = object.instance.display_meshes().into_iter().map(|part| {
        let vertices = part.mesh.vertices.iter().map(|vertex| [vertex.x, vertex.y, vertex.z]);
        MeshHeader::new(object.colour.unwrap_or(part.colour), vertices, part.mesh.triangles.iter().copied())
    });
    ObjectHeader { name: object.name.clone(), category: object.instance.category.clone(), meshes: meshes.collect() }
}

/// The robot's files: name, media type, path. What cannot be found is left out.
pub(super) fn files(request: &RunRequest<'_>) -> Vec<(String, &'static str, PathBuf)> {
    let Some(robot) = request.assets.robots.get(&request.scenario.robot.value) else { return Vec::new() };
    let beside = |file: &Path, relative: &str| file.parent().unwrap_or(Path::new("")).join(relative);
    let description = &request.model.description;
    let mut found = vec![(beside(robot, &description.urdf), "application/xml")];
    if let Some(profile) = &request.model.hand_profile {
        let folder = beside(robot, &description.hand_profile);
        found.extend([&profile.urdf_left, &profile.urdf_right].map(|urdf| (beside(&folder, urdf), "application/xml")));
    }
    let mut names = BTreeMap::new();
    for link in &request.model.tree.links {
        for part in &link.collision {
            if let Shape::Mesh { file, .. } = &part.shape {
                names.insert(file.clone(), beside(robot, file));
            }
        }
    }
    let urdfs =
        found.into_iter().map(|(path, media)| (path.file_name().unwrap_or_default().to_string_lossy().into_owned(), media, path));
    urdfs.chain(names.into_iter().map(|(name, path)| (name, "application/octet-stream", path))).collect()
}
