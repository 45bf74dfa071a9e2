//! A pose generator in a dynamic library that knows nothing but the C boundary, called through the plugin host.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they measured")]

use sfg_plugin::testing::{self, PoseScene};
use sfg_plugin::{PluginContext, PoseGenerator, PoseRequest};
use sfg_plugin_host::{Contract, HostError, LoadedPlugin, Registry, SearchPath, load_library};
use sfg_types::tsdf::{EDGE, Tsdf};
use sfg_types::{GraspType, HandProfile, HandSide, PalmPoseCandidate, Pose, SynergyCoordinates, Vector};
use std::path::{Path, PathBuf};

/// The library lies beside the test executable: cargo builds it as a dev-dependency of this crate.
fn centre_pose_library() -> PathBuf {
    let name = format!("{}sfg_centre_pose{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let path = std::env::current_exe().unwrap().with_file_name(name);
    assert!(path.is_file(), "{path:?} is missing: the dev-dependency sfg-centre-pose builds it");
    path
}

fn generator(hand: &HandProfile) -> Box<dyn PoseGenerator> {
    let mut registry = Registry::new();
    let added = registry.add_library(&load_library(&centre_pose_library()).unwrap()).unwrap();
    assert_eq!(added, [(Contract::PoseGenerator, "centre".to_owned())]);
    let params = serde_json::json!({});
    let context =
        PluginContext { params: &params, scenarios_dir: Path::new("scenarios"), hand, hand_side: HandSide::Left, seed: 7 };
    registry.make_pose_generator("centre", &context).unwrap()
}

fn ask(generator: &mut dyn PoseGenerator, request: &PoseRequest<'_>, capacity: usize) -> Vec<PalmPoseCandidate> {
    let blank = PalmPoseCandidate {
        base_from_palm: Pose::identity(),
        hand_side: HandSide::Left,
        stability: 0.0,
        synergy: SynergyCoordinates::OPEN,
        terms: Vec::new(),
    };
    let mut out = vec![blank; capacity];
    let n = generator.generate(request, &mut out).unwrap();
    out.truncate(n);
    out
}

/// The library's rule in this program's own types: the second implementation the values are compared with.
fn expected(request: &PoseRequest<'_>) -> PalmPoseCandidate {
    let voxels = (0..EDGE * EDGE * EDGE).filter(|&v| request.affordance_region[v] != 0);
    let parts: Vec<(Vector, bool)> = voxels
        .map(|v| {
            let (i, j, k) = (v % EDGE, v / EDGE % EDGE, v / (EDGE * EDGE));
            assert_eq!(Tsdf::index(i, j, k), v);
            (request.tsdf.centre_in_base(i, j, k).coords, request.tsdf.weights[v] > 0.0)
        })
        .collect();
    let profile = request.hand.grasp_types[&request.grasp_type];
    let centre = parts.iter().map(|(point, _)| point).sum::<Vector>() / parts.len() as f64;
    let half_turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI);
    PalmPoseCandidate {
        base_from_palm: Pose::from_parts((centre + Vector::z() * profile.standoff_min_m).into(), half_turn),
        hand_side: request.hand_side,
        stability: parts.iter().filter(|(_, seen)| *seen).count() as f64 / parts.len() as f64,
        synergy: profile.c_tar,
        terms: Vec::new(),
    }
}

#[test]
fn values_cross_the_boundary_in_both_directions() {
    let hand = testing::hand_profile();
    let mut generator = generator(&hand);
    let mut cylinder = PoseScene::cylinder();
    // A turned grid and a part of which every third voxel was not seen: every field of the view matters.
    cylinder.tsdf.base_from_grid *= Pose::new(Vector::new(0.01, -0.02, 0.03), Vector::new(0.3, -0.2, 0.9));
    cylinder.tsdf.weights.iter_mut().step_by(3).for_each(|weight| *weight = 0.0);
    for scene in [cylinder, PoseScene::ball()] {
        for side in [HandSide::Left, HandSide::Right] {
            for kind in GraspType::ALL {
                let request = scene.request(&hand, side, kind);
                let found = ask(generator.as_mut(), &request, 4);
                let expected = expected(&request);
                assert_eq!(found.len(), 1);
                let found = &found[0];
                let miss = (found.base_from_palm.translation.vector - expected.base_from_palm.translation.vector).norm();
                assert!(miss < 1e-12, "{kind}: the palm is {miss} m away from {expected:?}");
                assert!(found.base_from_palm.rotation.angle_to(&expected.base_from_palm.rotation) < 1e-12);
                assert_eq!((found.hand_side, found.stability, found.synergy), (side, expected.stability, expected.synergy));
                assert_eq!((found.terms[0].name.as_str(), found.terms[0].value), ("share_seen", expected.stability));
            }
        }
    }
}

#[test]
fn the_library_keeps_the_contract() {
    let hand = testing::hand_profile();
    assert_eq!(testing::pose_generator_suite(generator(&hand).as_mut(), &hand), Ok(()));
}

#[test]
fn a_plugin_error_arrives_with_its_own_words() {
    let full = testing::hand_profile();
    let mut generator = generator(&full);
    let mut hand = full.clone();
    hand.grasp_types.remove(&GraspType::Tripod);
    let scene = PoseScene::ball();
    let refused = generator.generate(&scene.request(&hand, HandSide::Left, GraspType::Tripod), &mut []);
    assert_eq!(refused.unwrap_err().to_string(), "plugin \"centre\" failed: the hand does not know the grasp type");
    assert_eq!(ask(generator.as_mut(), &scene.request(&hand, HandSide::Left, GraspType::Lateral), 1).len(), 1, "it lives on");
}

#[test]
fn libraries_share_one_process_and_outlive_their_handles() {
    let hand = testing::hand_profile();
    let first = load_library(&centre_pose_library()).unwrap();
    let second: LoadedPlugin = load_library(&centre_pose_library()).unwrap();
    assert_eq!(first.path(), second.path());
    assert!(first.offers("sfg.pose-generator/1") && !first.offers("sfg.pose-generator/2") && !first.offers(""));
    drop((first, second));
    // Made after the handles are gone, and moved to another thread.
    let scene = PoseScene::ball();
    let mut generator = generator(&hand);
    let found = std::thread::scope(|scope| {
        let request = scene.request(&hand, HandSide::Left, GraspType::MediumWrap);
        scope.spawn(move || ask(generator.as_mut(), &request, 1).len()).join().unwrap()
    });
    assert_eq!(found, 1);
}

#[test]
fn the_search_path_finds_it_and_a_second_copy_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join(format!("renamed{}", std::env::consts::DLL_SUFFIX));
    std::fs::copy(centre_pose_library(), &copy).unwrap();
    std::fs::write(folder.path().join(format!("broken{}", std::env::consts::DLL_SUFFIX)), "no library").unwrap();
    let path = SearchPath::new(&[centre_pose_library(), folder.path().to_owned()], None, Path::new("no such folder"));
    let found = path.find();
    assert_eq!((found.libraries.len(), found.skipped.len()), (3, 0), "{found:?}");
    let mut registry = Registry::new();
    let outcomes: Vec<_> = registry.add_found(&found).into_iter().map(|report| report.outcome).collect();
    assert!(outcomes[0].is_ok());
    assert!(matches!(outcomes[1], Err(HostError::NotLoadable { .. })), "{:?}", outcomes[1]);
    assert!(matches!(outcomes[2], Err(HostError::DuplicateName { .. })), "{:?}", outcomes[2]);
    assert_eq!(registry.names(Contract::PoseGenerator), ["centre"]);
}

/// How long a call takes, printed for the record; the bar only catches a call that copies far too much.
#[test]
fn a_call_costs_less_than_a_millisecond() {
    let hand = testing::hand_profile();
    let mut generator = generator(&hand);
    let scene = PoseScene::unobserved();
    let request = scene.request(&hand, HandSide::Left, GraspType::MediumWrap);
    let mut micros: Vec<u128> = (0..1000)
        .map(|_| {
            let start = std::time::Instant::now();
            assert_eq!(ask(generator.as_mut(), &request, 1).len(), 0);
            start.elapsed().as_micros()
        })
        .collect();
    micros.sort_unstable();
    println!("pose generator in a library: median {} us, p95 {} us of 1000 calls", micros[500], micros[950]);
    assert!(micros[500] < 1000, "median {} us", micros[500]);
}
