//! The grounder on rendered scenes of the project's object models: names, centres, sizes and heights against the truth.
//!
//! Development seeds; the models are used for rendering and judging only, the grounder sees images.

#![allow(clippy::unwrap_used, clippy::print_stderr, missing_docs, reason = "tests fail by panicking and print their figures")]

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_geometry::{ObjectInstance, ObjectModel};
use sfg_grounder_geometric::GeometricGrounder;
use sfg_plugin::{AffordanceQuery, Grounder, PluginContext};
use sfg_render::{Finish, Item, RenderMesh, Scene, SensorNoise, camera, render};
use sfg_types::{AffordanceMask, HandSide, ObjectCluster, Observation, Point, Pose, Vector};
use std::collections::BTreeMap;
use std::path::Path;

const TABLE_Z: f64 = 0.75;

struct Placed {
    name: &'static str,
    instance: ObjectInstance,
    base_from_object: Pose,
}

fn instance(name: &str, draws: [f64; 3]) -> ObjectInstance {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../scenarios/objects/{name}.yaml"));
    let model: ObjectModel = serde_saphyr::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    model.instantiate(&model.params_at(draws)).unwrap()
}

fn grounder() -> GeometricGrounder {
    let hand = serde_json::from_value(serde_json::json!({
        "name": "none", "urdf_left": "", "urdf_right": "", "palm_link": "", "joints": [], "synergy_joints": [], "synergy_matrix": [],
        "grasp_types": {}, "max_tension_nm": 1.0, "tendon_stiffness_nm_per_rad": 1.0, "max_current_amps": 1.0,
        "max_closing_speed_per_sec": 1.0
    }))
    .unwrap();
    let params = serde_json::json!({});
    let context =
        PluginContext { params: &params, scenarios_dir: Path::new("."), hand: &hand, hand_side: HandSide::default(), seed: 0 };
    GeometricGrounder::new(&context).unwrap()
}

/// Both views of the things on a wooden table, with the errors of the depth cameras.
fn observe(placed: &[Placed], seed: u64) -> Observation {
    let mut meshes = vec![(
        RenderMesh::new(&sfg_geometry::mesh::cuboid(&Vector::new(0.5, 0.7, 0.02))),
        Pose::translation(0.7, 0.0, TABLE_Z - 0.02),
        [150, 112, 78],
        Finish::Wood,
    )];
    for thing in placed {
        for display in thing.instance.display_meshes() {
            meshes.push((RenderMesh::new(&display.mesh), thing.base_from_object, display.colour, Finish::Plain));
        }
    }
    let items = meshes
        .iter()
        .map(|(mesh, pose, colour, finish)| Item {
            mesh,
            base_from_mesh: *pose,
            colour: *colour,
            finish: *finish,
            instance_id: 0,
            part_id: 0,
        })
        .collect();
    let scene = Scene { items, ..Scene::default() };
    let views = [("right", -0.20, 0), ("left", 0.20, 1)].map(|(name, y, idx)| {
        let pose = camera::look_at(&Point::new(0.10, y, 1.55), &Point::new(0.65, 0.0, 0.78));
        let mut frame = render(&scene, &camera::D435I, &pose);
        SensorNoise::default().apply(&mut frame, &camera::D435I, seed, 0, idx);
        frame.into_rgbd(name, &camera::D435I, &pose)
    });
    Observation { views: views.into(), stamp_secs: 0.0 }
}

fn nearest<'a>(clusters: &'a [ObjectCluster], at: &Pose) -> Option<(&'a ObjectCluster, f64)> {
    let miss = |c: &ObjectCluster| (c.centre_in_base.coords.xy() - at.translation.vector.xy()).norm();
    clusters.iter().map(|c| (c, miss(c))).min_by(|a, b| a.1.total_cmp(&b.1))
}

#[derive(Default)]
struct Tally {
    n: usize,
    named: usize,
    centre_misses_m: Vec<f64>,
    height_misses_m: Vec<f64>,
    width_misses_m: Vec<f64>,
}

/// `n_scenes` scenes with one thing of each group at random; returns figures per name.
fn sweep(groups: &[&[&'static str]], n_scenes: u64) -> (BTreeMap<&'static str, Tally>, f64, usize) {
    let mut tallies: BTreeMap<&'static str, Tally> = BTreeMap::new();
    let (mut worst_table, mut wrong_counts) = (0.0_f64, 0);
    let first = first_seed();
    for seed in first..first + n_scenes {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut placed: Vec<Placed> = Vec::new();
        for group in groups {
            let name = group[rng.random_range(0..group.len())];
            let instance = instance(name, [rng.random(), rng.random(), rng.random()]);
            let place = (0..200).find_map(|_| {
                let (x, y) = (rng.random_range(0.50..0.85), rng.random_range(-0.35..0.40));
                let pose = Pose::new(Vector::new(x, y, TABLE_Z), Vector::z() * rng.random_range(-3.0..3.0));
                let clear = placed
                    .iter()
                    .all(|other| (other.base_from_object.translation.vector - pose.translation.vector).norm() > 0.20);
                clear.then_some(pose)
            });
            if let Some(base_from_object) = place {
                placed.push(Placed { name, instance, base_from_object });
            }
        }
        let seen = grounder().list_scene(&observe(&placed, seed), &[]).unwrap();
        worst_table = worst_table.max((seen.table_height_m - TABLE_Z).abs());
        wrong_counts += usize::from(seen.clusters.len() != placed.len());
        for thing in &placed {
            let tally = tallies.entry(thing.name).or_default();
            tally.n += 1;
            let Some((cluster, miss)) = nearest(&seen.clusters, &thing.base_from_object) else { continue };
            let wanted = if thing.name == "tin_can" { "can" } else { thing.name };
            let named = cluster.names.first().is_some_and(|ranked| ranked.name == wanted);
            tally.named += usize::from(named);
            tally.centre_misses_m.push(miss);
            let (low, high) = thing.instance.bounds();
            tally.height_misses_m.push((cluster.size_m.z - high.z).abs());
            tally.width_misses_m.push((cluster.size_m.y - (high.y - low.y)).abs());
            if !named {
                eprintln!(
                    "seed {seed}: {} at {:.2?} size {:.3?} is seen as {:?} {:.3?} {:.2?}",
                    thing.name,
                    thing.base_from_object.translation.vector.as_slice(),
                    (high - low).as_slice(),
                    cluster.shape,
                    cluster.size_m.as_slice(),
                    cluster.names.iter().map(|n| (n.name.as_str(), n.score)).collect::<Vec<_>>()
                );
            }
        }
    }
    (tallies, worst_table, wrong_counts)
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(0.0)
}

/// Seeds 0..100 were in view while the vocabulary was written; begin elsewhere for figures that were not.
fn first_seed() -> u64 {
    std::env::var("SFG_GROUNDER_FIRST_SEED").ok().and_then(|n| n.parse().ok()).unwrap_or(0)
}

fn n_scenes() -> u64 {
    std::env::var("SFG_GROUNDER_SCENES").ok().and_then(|n| n.parse().ok()).unwrap_or(15)
}

#[test]
fn vessels_are_named_and_placed() {
    let groups: [&[&str]; 3] = [&["bottle"], &["bowl"], &["mug"]];
    let (mut tallies, worst_table, wrong_counts) = sweep(&groups, n_scenes());
    eprintln!("table off by at most {:.2} mm, {wrong_counts} scenes with a wrong number of things", worst_table * 1e3);
    for (name, tally) in &mut tallies {
        let named = tally.named as f64 / tally.n as f64;
        let centre = percentile(&mut tally.centre_misses_m, 0.95);
        let (height, width) = (percentile(&mut tally.height_misses_m, 0.95), percentile(&mut tally.width_misses_m, 0.95));
        eprintln!(
            "{name}: n {}, named {named:.2}, p95 centre {:.1} height {:.1} width {:.1} mm",
            tally.n,
            centre * 1e3,
            height * 1e3,
            width * 1e3
        );
        assert!(named >= 0.9 && centre < 0.006 && height < 0.010 && width < 0.010, "{name}");
    }
    assert!(worst_table < 0.002);
}

#[test]
fn other_things_are_seen_apart_and_mostly_named() {
    let groups: [&[&str]; 3] = [&["tin_can", "box", "ball"], &["cup", "pitcher"], &["hammer", "spatula"]];
    let (mut tallies, worst_table, _) = sweep(&groups, n_scenes());
    let (mut n, mut named) = (0, 0);
    for (name, tally) in &mut tallies {
        n += tally.n;
        named += tally.named;
        eprintln!(
            "{name}: n {}, named {}, p95 centre {:.1} mm",
            tally.n,
            tally.named,
            percentile(&mut tally.centre_misses_m, 0.95) * 1e3
        );
    }
    assert!(10 * named >= 7 * n && worst_table < 0.002, "{named} of {n}");
}

#[test]
fn body_of_the_bottle_and_handle_of_the_mug_are_masked() {
    for (name, affordance, high_m) in
        [("bottle", "body", 0.20), ("mug", "handle", 0.11), ("mug", "body", 0.11), ("hammer", "handle", 0.05)]
    {
        let thing = Placed {
            name,
            instance: instance(name, [0.5; 3]),
            base_from_object: Pose::new(Vector::new(0.62, 0.1, TABLE_Z), Vector::z() * 1.2),
        };
        let inverse = thing.base_from_object.inverse();
        let observation = observe(std::slice::from_ref(&thing), 1);
        let mut grounder = grounder();
        let seen = grounder.list_scene(&observation, &[]).unwrap();
        let cluster = nearest(&seen.clusters, &thing.base_from_object).unwrap().0;
        let mut masks: Vec<_> = observation.views.iter().map(|v| AffordanceMask::empty(&v.camera, 640, 480)).collect();
        grounder
            .ground(&AffordanceQuery { observation: &observation, cluster, object_name: name, affordance }, &mut masks)
            .unwrap();
        let (mut n, mut right) = (0, 0);
        for (view, mask) in observation.views.iter().zip(&masks) {
            for (pixel, &selected) in mask.pixels.iter().enumerate() {
                let depth = f64::from(view.depth_m[pixel]);
                if selected == 0 || depth <= 0.0 {
                    continue;
                }
                let (column, row) = ((pixel % 640) as f64, (pixel / 640) as f64);
                let p = inverse * (view.base_from_camera * view.intrinsics.deproject(column, row, depth));
                n += 1;
                right += usize::from(thing.instance.label_at(&p) == affordance && p.z < high_m);
            }
        }
        eprintln!("{name} {affordance}: {right} of {n} pixels");
        assert!(n > 60 && right as f64 > 0.8 * n as f64, "{name} {affordance}: {right} of {n}");
    }
}
