//! From the ranges of a scenario to one concrete scene.

use crate::assets::Assets;
use anyhow::{Context as _, Result};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sfg_driver_sim::world::{ObjectSpec, SceneSpec, TableSpec, WorldSettings};
use sfg_geometry::{Hollow, ObjectInstance, ObjectParams, ScannedObject};
use sfg_scenario::{ObjectShape, Range, Scenario, SceneObject};

/// The table begins this far ahead of the base, clear of the robot.
const TABLE_X_M: [f64; 2] = [0.52, 1.22];
/// Things keep at least this far from each other.
const GAP_M: f64 = 0.05;
/// Where distractors may stand.
const DISTRACTOR_X_M: Range = Range { min: 0.66, max: 1.02 };
const DISTRACTOR_Y_M: Range = Range { min: -0.35, max: 0.5 };
const MAX_PLACEMENTS: usize = 2000;
const PART_COLOURS: [[u8; 3]; 6] =
    [[178, 60, 52], [60, 105, 178], [88, 140, 70], [200, 160, 60], [120, 84, 150], [150, 150, 150]];

/// Draws the scene of `seed`.
pub(crate) fn draw_scene(scenario: &Scenario, assets: &Assets, seed: u64) -> Result<SceneSpec> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = |range: Range| range.at(rng.random::<f64>());
    let scene = &scenario.scene;
    let table = TableSpec { height_m: draw(scene.table_height_m), x_m: TABLE_X_M, ..TableSpec::default() };
    let settings = WorldSettings { pair_friction: draw(scene.friction), ..WorldSettings::default() };
    let mut placed: Vec<Footprint> = Vec::new();
    let mut objects = Vec::new();
    for object in &scene.objects {
        let instance = instance_of(object, scenario, assets, &mut draw)?;
        let radius_m = footprint_radius_m(&instance);
        let (x_m, y_m) = free_place(&placed, radius_m, object.placement.x_m, object.placement.y_m, &mut draw)
            .with_context(|| format!("object {:?} finds no free place in its range; widen `at`", object.name.value))?;
        placed.push(Footprint { x_m, y_m, radius_m });
        let mut spec = ObjectSpec::new(&object.name.value, instance, x_m, y_m, draw(object.placement.yaw_rad));
        if object.filled_grains > 0 {
            spec = spec.with_grains(object.filled_grains as usize);
        }
        objects.push(spec);
    }
    if let Some(distractors) = &scene.distractors {
        for n in 0..distractors.n {
            let known: Vec<&String> = match distractors.from.as_slice() {
                [] => assets.models.keys().collect(),
                from => from.iter().map(|name| &name.value).collect(),
            };
            let pick = (draw(Range { min: 0.0, max: known.len() as f64 }) as usize).min(known.len() - 1);
            let name = known[pick];
            let model = &assets.models[name];
            let params = model.params_at([draw(UNIT), draw(UNIT), draw(UNIT)]);
            let mut instance = model.instantiate(&params)?;
            let colour = PART_COLOURS[(draw(Range { min: 0.0, max: 5.999 }) as usize).min(5)];
            for part in &mut instance.parts {
                part.colour = colour;
            }
            let radius_m = footprint_radius_m(&instance);
            let place = free_place(&placed, radius_m, DISTRACTOR_X_M, DISTRACTOR_Y_M, &mut draw);
            // A crowded table takes fewer of them.
            if let Some((x_m, y_m)) = place {
                placed.push(Footprint { x_m, y_m, radius_m });
                let yaw_rad = draw(Range { min: -std::f64::consts::PI, max: std::f64::consts::PI });
                objects.push(ObjectSpec::new(&format!("distractor_{}_{name}", n + 1), instance, x_m, y_m, yaw_rad));
            }
        }
    }
    Ok(SceneSpec { table, objects, settings, seed })
}

const UNIT: Range = Range { min: 0.0, max: 1.0 };

/// One instance of `object`; the files of a scan are found beside the file that names them.
pub(crate) fn instance_of(
    object: &SceneObject,
    scenario: &Scenario,
    assets: &Assets,
    draw: &mut impl FnMut(Range) -> f64,
) -> Result<ObjectInstance> {
    match &object.shape {
        ObjectShape::Model(name) => {
            let model = &assets.models[&name.value];
            let nominal = model.nominal_params();
            let params = ObjectParams {
                height: nominal.height * draw(object.height_scale),
                radius: nominal.radius * draw(object.radius_scale),
                mass_kg: nominal.mass_kg * draw(object.mass_scale),
            };
            Ok(model.instantiate(&params)?)
        }
        ObjectShape::Scanned { mesh, hulls, mass_kg, hollow } => {
            let scan = ScannedObject {
                category: object.name.value.clone(),
                words: vec![object.name.value.clone()],
                mesh: scenario.resolve(mesh),
                hulls: scenario.resolve(hulls),
                mass_kg: *mass_kg,
                hollow: hollow.map(|hollow| Hollow { mouth_m: hollow.mouth_m, wall_m: hollow.wall_m }),
                colour: [170, 150, 60],
            };
            Ok(scan.load()?)
        }
    }
}

struct Footprint {
    x_m: f64,
    y_m: f64,
    radius_m: f64,
}

/// Farthest that anything of the object lies from its vertical axis.
fn footprint_radius_m(instance: &ObjectInstance) -> f64 {
    let meshes = instance.display_meshes();
    let vertices = meshes.iter().flat_map(|part| part.mesh.vertices.iter());
    vertices.map(|vertex| vertex.x.hypot(vertex.y)).fold(0.0, f64::max)
}

fn free_place(
    placed: &[Footprint],
    radius_m: f64,
    x_m: Range,
    y_m: Range,
    draw: &mut impl FnMut(Range) -> f64,
) -> Option<(f64, f64)> {
    for _ in 0..MAX_PLACEMENTS {
        let (x, y) = (draw(x_m), draw(y_m));
        let is_free = placed.iter().all(|other| (other.x_m - x).hypot(other.y_m - y) >= other.radius_m + radius_m + GAP_M);
        if is_free {
            return Some((x, y));
        }
    }
    None
}
