//! What Foxglove draws: `/scene` with robot, table and objects, `/scene/grasp` with palm poses, key point and path.
//!
//! Each update holds the whole of its topic, so that a viewer that jumps to a moment has all of it.

use crate::frames::{base_frame, object_frame};
use crate::messages::{Candidates, KeyPoint, LinkHeader, ObjectHeader, RunHeader, ShapeHeader, TableHeader, nanos};
use crate::recording::{timestamp, typed};
use foxglove::messages::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, KeyValuePair, LinePrimitive, Point3, Pose, Quaternion, SceneEntity,
    SceneEntityDeletion, SceneUpdate, SpherePrimitive, TriangleListPrimitive, Vector3, line_primitive, scene_entity_deletion,
};
use foxglove::{Channel, Context};
use sfg_types::layout::PoseLayout;
use std::sync::Arc;

const TABLE: Color = Color { r: 0.74, g: 0.67, b: 0.57, a: 1.0 };
const KEY_POINT: Color = Color { r: 0.86, g: 0.08, b: 0.24, a: 1.0 };
const PATH: Color = Color { r: 0.0, g: 0.67, b: 0.35, a: 1.0 };
const CHOSEN: Color = Color { r: 0.0, g: 0.67, b: 0.35, a: 1.0 };
const REJECTED: Color = Color { r: 0.55, g: 0.35, b: 0.35, a: 0.6 };
const TABLE_THICKNESS_M: f64 = 0.03;

pub(crate) struct Scene {
    bodies: Channel<SceneUpdate>,
    grasp: Channel<SceneUpdate>,
    base: String,
    /// What `/scene/grasp` shows now.
    entities: Vec<SceneEntity>,
}

fn colour([r, g, b]: [u8; 3]) -> Color {
    let share = |value: u8| f64::from(value) / 255.0;
    Color { r: share(r), g: share(g), b: share(b), a: 1.0 }
}

/// From red at 0 to green-blue at 1.
fn score_colour(score: f64) -> Color {
    let score = score.clamp(0.0, 1.0);
    Color { r: 0.9 - 0.7 * score, g: 0.3 + 0.4 * score, b: 0.2 + 0.6 * score, a: 0.9 }
}

fn pose(layout: &PoseLayout) -> Option<Pose> {
    let ([x, y, z], [rx, ry, rz, rw]) = (layout.translation, layout.rotation);
    Some(Pose { position: Some(Vector3 { x, y, z }), orientation: Some(Quaternion { x: rx, y: ry, z: rz, w: rw }) })
}

fn at([x, y, z]: [f64; 3]) -> Option<Pose> {
    pose(&PoseLayout { rotation: [0.0, 0.0, 0.0, 1.0], translation: [x, y, z] })
}

fn size(x: f64, y: f64, z: f64) -> Option<Vector3> {
    Some(Vector3 { x, y, z })
}

fn entity(frame: &str, id: &str) -> SceneEntity {
    SceneEntity { frame_id: frame.to_owned(), id: id.to_owned(), frame_locked: true, ..SceneEntity::default() }
}

fn link(link: &LinkHeader) -> SceneEntity {
    let mut entity = entity(&link.name, &format!("link/{}", link.name));
    for shape in &link.shapes {
        add_shape(&mut entity, shape);
    }
    entity
}

fn add_shape(entity: &mut SceneEntity, shape: &ShapeHeader) {
    let color = Some(colour(shape.colour));
    let pose = pose(&shape.origin);
    match (shape.kind.as_str(), shape.size.as_slice()) {
        ("box", [x, y, z]) => entity.cubes.push(CubePrimitive { pose, size: size(*x, *y, *z), color }),
        ("sphere", [radius]) => {
            let size = size(2.0 * radius, 2.0 * radius, 2.0 * radius);
            entity.spheres.push(SpherePrimitive { pose, size, color });
        }
        ("cylinder" | "capsule", [radius, length]) => {
            let size_m = size(2.0 * radius, 2.0 * radius, *length);
            entity.cylinders.push(CylinderPrimitive { pose, size: size_m, bottom_scale: 1.0, top_scale: 1.0, color });
            if shape.kind == "capsule" {
                for end in [-0.5, 0.5] {
                    let mut ball = ShapeHeader { kind: "sphere".to_owned(), size: vec![*radius], ..shape.clone() };
                    let axis = nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::from(nalgebra::Vector4::from(
                        shape.origin.rotation,
                    ))) * nalgebra::Vector3::z();
                    for (place, along) in ball.origin.translation.iter_mut().zip(axis.iter()) {
                        *place += end * length * along;
                    }
                    add_shape(entity, &ball);
                }
            }
        }
        // Meshes of robots come as attachments.
        _ => {}
    }
}

fn table(base: &str, table: &TableHeader) -> SceneEntity {
    let ([x0, y0], [x1, y1]) = (table.low, table.high);
    let mut entity = entity(base, "table");
    entity.cubes.push(CubePrimitive {
        pose: at([(x0 + x1) / 2.0, (y0 + y1) / 2.0, table.height_m - TABLE_THICKNESS_M / 2.0]),
        size: size(x1 - x0, y1 - y0, TABLE_THICKNESS_M),
        color: Some(TABLE),
    });
    entity
}

fn object(object: &ObjectHeader) -> SceneEntity {
    let mut entity = entity(&object_frame(&object.name), &format!("object/{}", object.name));
    for mesh in &object.meshes {
        let (vertices, indices) = mesh.decoded();
        entity.triangles.push(TriangleListPrimitive {
            pose: at([0.0; 3]),
            points: vertices.into_iter().map(|[x, y, z]| Point3 { x, y, z }).collect(),
            color: Some(colour(mesh.colour)),
            colors: Vec::new(),
            indices,
        });
    }
    entity
}

fn show(channel: &Channel<SceneUpdate>, mut entities: Vec<SceneEntity>, log_time_ns: u64) {
    for entity in &mut entities {
        entity.timestamp = Some(timestamp(log_time_ns));
    }
    // What an earlier update showed would stay otherwise.
    let all = SceneEntityDeletion {
        timestamp: Some(timestamp(log_time_ns)),
        r#type: scene_entity_deletion::Type::All as i32,
        ..SceneEntityDeletion::default()
    };
    channel.log_with_time(&SceneUpdate { deletions: vec![all], entities }, log_time_ns);
}

impl Scene {
    pub(crate) fn new(context: &Arc<Context>) -> Self {
        let (bodies, grasp) = (typed(context, "/scene"), typed(context, "/scene/grasp"));
        Self { bodies, grasp, base: String::new(), entities: Vec::new() }
    }

    pub(crate) fn begin(&mut self, header: &RunHeader) {
        self.base = base_frame(header);
        let links = header.links.iter().filter(|link| !link.shapes.is_empty()).map(link);
        let table = header.table.as_ref().map(|found| table(&self.base, found));
        let entities = links.chain(table).chain(header.objects.iter().map(object)).collect();
        show(&self.bodies, entities, 0);
    }

    /// Puts an entity in the place of the one with its name.
    fn put(&mut self, entity: SceneEntity) {
        match self.entities.iter_mut().find(|old| old.id == entity.id) {
            Some(old) => *old = entity,
            None => self.entities.push(entity),
        }
    }

    fn show(&self, stamp_secs: f64) {
        show(&self.grasp, self.entities.clone(), nanos(stamp_secs));
    }

    pub(crate) fn key_point(&mut self, message: &KeyPoint) {
        let mut entity = entity(&self.base, "key_point");
        let ball = SpherePrimitive { pose: at(message.point_in_base), size: size(0.02, 0.02, 0.02), color: Some(KEY_POINT) };
        entity.spheres.push(ball);
        self.put(entity);
        self.show(message.stamp_secs);
    }

    /// An arrow a palm pose, along its approach; the numbers are the entity's metadata.
    pub(crate) fn candidates(&mut self, message: &Candidates<'_>) {
        self.entities.retain(|entity| !entity.id.starts_with("candidate/"));
        for entry in &message.candidates {
            let mut entity = entity(&self.base, &format!("candidate/{}", entry.idx));
            let is_chosen = message.chosen == Some(entry.idx);
            let is_rejected = entry.rejected.as_ref().is_some_and(|rejection| rejection.why != "ranked_lower");
            let scale = if is_chosen { 1.5 } else { 1.0 };
            // Arrows point along X; the palm approaches along Z.
            let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), -std::f64::consts::FRAC_PI_2);
            let back = sfg_types::Pose::translation(0.0, 0.0, -0.06 * scale);
            entity.arrows.push(ArrowPrimitive {
                pose: pose(&PoseLayout::from(entry.candidate.base_from_palm * back * turn)),
                shaft_length: 0.045 * scale,
                shaft_diameter: 0.004 * scale,
                head_length: 0.015 * scale,
                head_diameter: 0.01 * scale,
                color: Some(match (is_chosen, is_rejected) {
                    (true, _) => CHOSEN,
                    (_, true) => REJECTED,
                    _ => score_colour(entry.candidate.stability),
                }),
            });
            let pair = |key: &str, value: String| KeyValuePair { key: key.to_owned(), value };
            entity.metadata.push(pair("stability", format!("{:.3}", entry.candidate.stability)));
            entity.metadata.extend(entry.candidate.terms.iter().map(|term| pair(&term.name, format!("{:.3}", term.value))));
            entity.metadata.extend(entry.rejected.iter().map(|rejection| pair("rejected", rejection.text.clone())));
            self.entities.push(entity);
        }
        let mut path = entity(&self.base, "path");
        path.lines.push(LinePrimitive {
            r#type: line_primitive::Type::LineStrip as i32,
            pose: at([0.0; 3]),
            thickness: 0.004,
            points: message.path.iter().map(|[x, y, z]| Point3 { x: *x, y: *y, z: *z }).collect(),
            color: Some(PATH),
            ..LinePrimitive::default()
        });
        self.put(path);
        self.show(message.stamp_secs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_capsule_is_a_cylinder_with_balls_at_its_ends() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let shape = ShapeHeader {
            kind: "capsule".to_owned(),
            size: vec![0.1, 0.4],
            // Z turned onto X.
            origin: PoseLayout { rotation: [0.0, half, 0.0, half], translation: [1.0, 0.0, 0.0] },
            colour: [255, 0, 0],
            mesh: None,
        };
        let mut entity = entity("a", "a");
        add_shape(&mut entity, &shape);
        let ends: Vec<f64> = entity.spheres.iter().filter_map(|ball| Some(ball.pose.as_ref()?.position.as_ref()?.x)).collect();
        assert!(entity.cylinders.len() == 1 && (ends[0] - 0.8).abs() < 1e-9 && (ends[1] - 1.2).abs() < 1e-9, "{ends:?}");
    }
}
