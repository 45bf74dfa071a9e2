//! The grounder on rendered scenes of the project's object models: names, centres, sizes and heights against the truth.
//!
//! Development seeds; the models are used for rendering and judging only, the grounder sees images.

#![allow(clippy::unwrap_used, clippy::print_stderr, missing_docs, reason = "tests fail by panicking and print their figures")]

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_geometry::{ObjectInstance, ObjectModel, TriMesh};
use sfg_grounder_geometric::GeometricGrounder;
use sfg_plugin::{AffordanceQuery, Grounder, PluginContext};
use sfg_render::{Finish, Item, RenderMesh, Scene, SensorNoise, camera, render};
use sfg_types::{AffordanceMask, HandSide, ObjectCluster, Observation, Point, Pose, ShapeClass, Vector};
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
    let shown = placed.iter().flat_map(|thing| {
        let displayed = thing.instance.display_meshes().into_iter();
        displayed.map(|display| (display.mesh, thing.base_from_object, display.colour))
    });
    observe_meshes(shown, seed)
}

fn observe_meshes(shown: impl IntoIterator<Item = (TriMesh, Pose, [u8; 3])>, seed: u64) -> Observation {
    let mut meshes = vec![(
        RenderMesh::new(&sfg_geometry::mesh::cuboid(&Vector::new(0.5, 0.7, 0.02))),
        Pose::translation(0.7, 0.0, TABLE_Z - 0.02),
        [150, 112, 78],
        Finish::Wood,
    )];
    meshes.extend(shown.into_iter().map(|(mesh, pose, colour)| (RenderMesh::new(&mesh), pose, colour, Finish::Plain)));
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

/// A closed loft of superellipses: `[height, half length, half width, exponent]` from the base up.
fn loft(rings: &[[f64; 4]]) -> TriMesh {
    const N: u32 = 72;
    let mut vertices = Vec::new();
    for [z, a, b, exponent] in rings {
        for i in 0..N {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(N)).sin_cos();
            let r = (cos.abs().powf(*exponent) + sin.abs().powf(*exponent)).powf(-1.0 / exponent);
            vertices.push(Point::new(a * r * cos, b * r * sin, *z));
        }
    }
    let (base, top) = (vertices.len() as u32, vertices.len() as u32 + 1);
    vertices.extend([Point::new(0.0, 0.0, rings[0][0]), Point::new(0.0, 0.0, rings[rings.len() - 1][0])]);
    let mut triangles = Vec::new();
    for i in 0..N {
        let j = (i + 1) % N;
        for ring in 0..rings.len() as u32 - 1 {
            let (low, high) = (ring * N, (ring + 1) * N);
            triangles.extend([[low + i, low + j, high + j], [low + i, high + j, high + i]]);
        }
        triangles.extend([[base, j, i], [top, base - N + i, base - N + j]]);
    }
    TriMesh::new(vertices, triangles)
}

const SHAMPOO: &[[f64; 4]] = &[
    [0.0, 0.036, 0.020, 2.0],
    [0.006, 0.040, 0.023, 2.0],
    [0.135, 0.040, 0.023, 2.0],
    [0.150, 0.034, 0.022, 2.0],
    [0.158, 0.018, 0.016, 2.0],
    [0.162, 0.015, 0.015, 2.0],
    [0.185, 0.015, 0.015, 2.0],
];
const SOAP: &[[f64; 4]] = &[
    [0.0, 0.040, 0.024, 3.5],
    [0.005, 0.045, 0.0275, 3.5],
    [0.050, 0.044, 0.027, 3.5],
    [0.090, 0.038, 0.025, 3.5],
    [0.130, 0.044, 0.027, 3.5],
    [0.160, 0.040, 0.027, 3.0],
    [0.172, 0.026, 0.022, 2.0],
    [0.178, 0.016, 0.016, 2.0],
    [0.212, 0.013, 0.013, 2.0],
];
/// Round, with a neck.
const FLASK: &[[f64; 4]] = &[
    [0.0, 0.030, 0.030, 2.0],
    [0.150, 0.030, 0.030, 2.0],
    [0.165, 0.022, 0.022, 2.0],
    [0.175, 0.015, 0.015, 2.0],
    [0.210, 0.014, 0.014, 2.0],
];

/// A loft alone on the table as the grounder sees it, with its pose and yaw: `posture` is applied before it is put down.
fn seen_alone(rings: &[[f64; 4]], posture: &Pose, seed: u64) -> (ObjectCluster, Pose, f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (x, y, yaw) = (rng.random_range(0.6..0.85), rng.random_range(-0.1..0.4), rng.random_range(-1.5..1.5));
    let pose = Pose::new(Vector::new(x, y, TABLE_Z), Vector::z() * yaw) * posture;
    let mesh = loft(rings);
    assert_eq!(mesh.n_open_edges(), 0);
    let seen = grounder().list_scene(&observe_meshes([(mesh, pose, [230, 200, 40])], seed), &[]).unwrap();
    (nearest(&seen.clusters, &pose).unwrap().0.clone(), pose, yaw)
}

fn is_called_bottle(cluster: &ObjectCluster) -> bool {
    cluster.names.first().is_some_and(|ranked| ranked.name == "bottle")
}

#[test]
fn flat_bottles_are_bottles_and_stand_where_they_are() {
    for rings in [SHAMPOO, SOAP] {
        let (mut n, mut named, mut oval, mut centre_m, mut yaw_rad) = (0, 0, 0, Vec::new(), Vec::new());
        for seed in first_seed()..first_seed() + 2 * n_scenes() {
            let (cluster, pose, yaw) = seen_alone(rings, &Pose::identity(), seed);
            n += 1;
            named += usize::from(is_called_bottle(&cluster));
            if cluster.shape == ShapeClass::UprightOval {
                oval += 1;
                yaw_rad.push((cluster.yaw_rad - yaw).sin().abs());
            }
            centre_m.push((cluster.centre_in_base.coords.xy() - pose.translation.vector.xy()).norm());
        }
        let (centre, yaw) = (percentile(&mut centre_m, 0.9), percentile(&mut yaw_rad, 0.9));
        eprintln!("flat bottle: n {n}, named {named}, oval {oval}, p90 centre {:.1} mm, yaw {yaw:.2} rad", centre * 1e3);
        assert!(20 * named >= 19 * n && 10 * oval >= 9 * n && centre < 0.010 && yaw < 0.15);
    }
}

#[test]
fn bottles_that_lie_are_still_bottles() {
    let (mut n, mut named) = (0, 0);
    for rings in [SHAMPOO, SOAP, FLASK] {
        let lying_m = rings.iter().map(|ring| ring[2]).fold(0.0, f64::max);
        let fallen = Pose::new(Vector::z() * lying_m, Vector::x() * std::f64::consts::FRAC_PI_2);
        for seed in first_seed()..first_seed() + n_scenes() {
            let (cluster, ..) = seen_alone(rings, &fallen, seed);
            n += 1;
            named += usize::from(is_called_bottle(&cluster));
        }
    }
    eprintln!("lying bottles: {named} of {n} named");
    assert!(20 * named >= 19 * n, "{named} of {n}");
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
