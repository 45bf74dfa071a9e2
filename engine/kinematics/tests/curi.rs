//! The shipped robot against published anchors, and the laws that its kinematics obey.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and say what they pass over")]

use nalgebra::Vector6;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, RobotModel, Tree};
use sfg_types::{HandSide, Pose};
use std::path::{Path, PathBuf};

fn robots_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots")
}

fn curi() -> RobotModel {
    RobotModel::load(&robots_dir().join("curi.yaml")).unwrap()
}

/// Panda alone: shoulder mount to flange.
fn panda() -> Chain {
    let model = RobotModel::load_without_hands(&robots_dir().join("curi.yaml")).unwrap();
    let joints = &model.description.arms.left.joints;
    let chain = Chain::new(&model.tree, "panda_left_link0", "panda_left_link7", joints, &model.home_q).unwrap();
    chain.with_tip(&Pose::translation(0.0, 0.0, 0.107))
}

fn gap(a: &Pose, b: &Pose) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
}

#[track_caller]
fn assert_near(a: &Pose, b: &Pose, tolerance: f64) {
    let (metres, radians) = gap(a, b);
    assert!(metres < tolerance && radians < tolerance, "{metres:e} m, {radians:e} rad apart");
}

#[test]
fn the_flange_of_the_ready_panda_is_where_franka_says() {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
    let flange = panda().fk(&[0.0, -FRAC_PI_4, 0.0, -3.0 * FRAC_PI_4, 0.0, FRAC_PI_2, FRAC_PI_4]);
    let at = flange.translation.vector;
    assert!((at.x - 0.3069).abs() < 1e-4 && at.y.abs() < 1e-6 && (at.z - 0.5903).abs() < 1e-4, "{at}");
    let forward = flange.rotation * nalgebra::Vector3::z();
    assert!((forward.z + 1.0).abs() < 1e-9, "the hand points down, not along {forward}");
}

#[test]
fn chain_and_tree_agree() {
    let model = curi();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for side in [HandSide::Left, HandSide::Right] {
        let arm = model.arm(side);
        for _ in 0..200 {
            let q = random_q(&arm.chain, &mut rng);
            let poses = model.link_poses(&model.q_with_arm(side, &q));
            assert_near(&arm.chain.fk(&q), &poses[model.tree.link_idx(&arm.tip_link).unwrap()], 1e-9);
            let all = arm.chain.fk_all(&q);
            assert_eq!(all.len(), 8);
            for (name, pose) in arm.chain.link_names.iter().zip(&all) {
                assert_near(pose, &poses[model.tree.link_idx(name).unwrap()], 1e-9);
            }
        }
    }
}

#[test]
fn the_jacobian_is_the_derivative_of_fk() {
    let chain = curi().left.chain;
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let h = 1e-6;
    for _ in 0..100 {
        let q = random_q(&chain, &mut rng);
        let numeric = nalgebra::Matrix6xX::from_columns(
            &(0..7)
                .map(|joint| {
                    let moved = |step: f64| {
                        let mut q = q.clone();
                        q[joint] += step;
                        chain.fk(&q)
                    };
                    let (a, b) = (moved(-h), moved(h));
                    let linear = (b.translation.vector - a.translation.vector) / (2.0 * h);
                    let angular = (b.rotation * a.rotation.inverse()).scaled_axis() / (2.0 * h);
                    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
                })
                .collect::<Vec<_>>(),
        );
        let difference = (chain.jacobian(&q).fixed_rows::<6>(0) - numeric).abs().max();
        assert!(difference < 1e-7, "{difference:e}");
    }
}

#[test]
fn fk_of_ik_is_the_target_and_ik_solves_nearly_every_reachable_pose() {
    let chain = panda();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let settings = IkSettings::default();
    let (n, mut n_solved) = (1_000, 0);
    for _ in 0..n {
        let target = chain.fk(&random_q(&chain, &mut rng));
        let seed_q = random_q(&chain, &mut rng);
        match IkSolver::solve(&chain, &target, &seed_q, &settings, &mut rng) {
            IkOutcome::Solved { q, .. } => {
                n_solved += 1;
                assert!(chain.is_inside_limits(&q, 0.0));
                assert_near(&chain.fk(&q), &target, 1.01e-5);
            }
            IkOutcome::Failed { best_q, position_miss_m, rotation_miss_rad } => {
                let (metres, radians) = gap(&chain.fk(&best_q), &target);
                assert!((metres - position_miss_m).abs() < 1e-9 && (radians - rotation_miss_rad).abs() < 1e-6);
            }
        }
    }
    assert!(n_solved >= 995, "{n_solved} of {n}");
}

#[test]
fn an_unreachable_pose_fails_with_its_miss() {
    let chain = panda();
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let settings = IkSettings { max_starts: 10, ..IkSettings::default() };
    let target = Pose::translation(2.0, 0.0, 0.333);
    match IkSolver::solve(&chain, &target, &chain.middle(), &settings, &mut rng) {
        // The flange reaches at most 0.316 + 0.384 + 0.088 + 0.107 m and the elbow's offsets from the shoulder.
        IkOutcome::Failed { position_miss_m, .. } => assert!(position_miss_m > 1.0, "{position_miss_m} m"),
        IkOutcome::Solved { q, .. } => panic!("solved by {q:?}"),
    }
}

#[test]
fn the_seed_and_the_posture_choose_among_solutions() {
    let chain = panda();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let posture = vec![0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8];
    let (mut n_near, mut pulled, mut plain) = (0, 0.0, 0.0);
    for _ in 0..100 {
        let mut q = random_q(&chain, &mut rng);
        q.iter_mut().zip(chain.middle()).for_each(|(q, middle)| *q = middle + 0.7 * (*q - middle));
        let nudged: Vec<f64> = q.iter().map(|v| v + 0.02).collect();
        let target = chain.fk(&nudged);
        let near = IkSolver::solve(&chain, &target, &q, &IkSettings::default(), &mut rng).solution().unwrap();
        n_near += usize::from(distance(&near, &q) < 0.2);
        let settings = IkSettings { posture_q: Some(posture.clone()), ..IkSettings::default() };
        let drawn = IkSolver::solve(&chain, &target, &q, &settings, &mut rng).solution().unwrap();
        assert_near(&chain.fk(&drawn), &target, 1.01e-5);
        pulled += distance(&drawn, &posture);
        plain += distance(&near, &posture);
    }
    assert!(n_near >= 95, "{n_near} of 100 solutions stayed near the seed");
    assert!(pulled < 0.95 * plain, "the posture drew by {plain} -> {pulled}");
}

#[test]
fn same_seed_same_solution() {
    let chain = panda();
    let target = chain.fk(&[0.4, 0.2, -0.3, -1.5, 0.9, 2.0, -0.7]);
    let solve = |seed| IkSolver::solve(&chain, &target, &[2.0; 7], &IkSettings::default(), &mut ChaCha8Rng::seed_from_u64(seed));
    assert_eq!(solve(9), solve(9));
    let several =
        IkSolver::solve_several(&chain, &target, &[0.0; 7], 8, &IkSettings::default(), &mut ChaCha8Rng::seed_from_u64(9));
    assert_eq!(several.len(), 8);
    several.iter().for_each(|q| assert_near(&chain.fk(q), &target, 1.01e-5));
}

#[test]
fn left_and_right_arm_are_mirror_images() {
    let model = curi();
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    // Mirroring the robot at its XZ plane turns joints 1, 3, 5, 7 the other way.
    for _ in 0..20 {
        let left_q = random_q(&model.left.chain, &mut rng);
        let right_q: Vec<f64> = left_q.iter().enumerate().map(|(i, v)| if i % 2 == 0 { -v } else { *v }).collect();
        let left = model.link_poses(&model.q_with_arm(HandSide::Left, &left_q));
        let right = model.link_poses(&model.q_with_arm(HandSide::Right, &right_q));
        let at = |poses: &[Pose], name: &str| poses[model.tree.link_idx(name).unwrap()].translation.vector;
        let (l, r) = (at(&left, "panda_left_link7"), at(&right, "panda_right_link7"));
        assert!((l.x - r.x).abs() + (l.y + r.y).abs() + (l.z - r.z).abs() < 1e-9, "{l} {r}");
    }
}

#[test]
fn frames_limits_and_masses_agree_with_the_published_model() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/robots/curi/curi_w_softhand.urdf");
    if !path.exists() {
        eprintln!("passed over: {} is absent", path.display());
        return;
    }
    let published = Tree::load(&path).unwrap();
    let model = curi();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let ours = |name: &str| match name {
        "left_qbhand_base_link" => model.left.hand_root_link.clone().unwrap(),
        "right_qbhand_base_link" => model.right.hand_root_link.clone().unwrap(),
        "summit_xls_base_footprint" => "base".to_owned(),
        other => other.to_owned(),
    };
    let mut links = vec!["torso_end", "torso_middle", "torso_link_b1", "torso_link_c2", "head_link2", "control_box"];
    links.extend(["left_qbhand_base_link", "right_qbhand_base_link"]);
    let arms: Vec<String> = ["left", "right"].iter().flat_map(|s| (0..8).map(move |i| format!("panda_{s}_link{i}"))).collect();
    links.extend(arms.iter().map(String::as_str));
    for _ in 0..20 {
        let mut published_q = vec![0.0; published.n_q()];
        let mut q = model.home_q.clone();
        for (idx, name) in model.tree.q_names.iter().enumerate() {
            let Ok(published_idx) = published.q_idx(name) else { continue };
            let (a, b) = (model.tree.independent_joint(idx), published.independent_joint(published_idx));
            if !name.contains("hand") && !name.contains("thumb") {
                assert_eq!((a.lower, a.upper, a.velocity, a.effort), (b.lower, b.upper, b.velocity, b.effort), "{name}");
            }
            if name.starts_with("panda") || name.contains("actuated") {
                q[idx] = rand::Rng::random_range(&mut rng, a.lower..=a.upper);
                published_q[published_idx] = q[idx];
            }
        }
        let (a, b) = (model.link_poses(&q), published.link_poses(&published_q));
        for name in &links {
            // The published mount angles carry four to five digits.
            assert_near(&a[model.tree.link_idx(&ours(name)).unwrap()], &b[published.link_idx(name).unwrap()], 2e-5);
        }
    }
    for name in arms.iter().map(String::as_str).chain(["torso_end", "torso_base2", "control_box"]) {
        let (a, b) = (&model.tree.links[model.tree.link_idx(name).unwrap()], &published.links[published.link_idx(name).unwrap()]);
        assert!((a.inertial.mass_kg - b.inertial.mass_kg).abs() < 1e-6, "{name}");
        assert!((a.inertial.inertia - b.inertial.inertia).abs().max() < 1e-5, "{name}");
    }
}

#[test]
fn every_inertia_is_physical_and_every_collision_shape_a_primitive() {
    let model = curi();
    for link in &model.tree.links {
        assert!(!link.collision.iter().any(|p| matches!(p.shape, sfg_kinematics::Shape::Mesh { .. })), "{}", link.name);
        if link.inertial.mass_kg > 0.0 {
            let e = link.inertial.inertia.symmetric_eigenvalues();
            let fits = e.min() > 0.0 && e.max() <= (e.sum() - e.max()) * 1.0001;
            assert!(fits, "{}: principal inertias {e}", link.name);
        }
    }
}

#[test]
fn the_cameras_see_the_table_and_stand_above_the_shoulders() {
    let model = curi();
    assert_eq!(model.cameras.len(), 2);
    let shoulder_z = model.link_poses(&model.home_q)[model.tree.link_idx("panda_left_link0").unwrap()].translation.z;
    for (camera, pose) in model.cameras.iter().zip(model.camera_poses(&model.home_q)) {
        assert!(pose.translation.z > shoulder_z);
        assert!((pose.rotation * nalgebra::Vector3::y()).z < 0.0, "the image is upside down");
        for corner in [[0.5, -0.2, 0.75], [0.5, 0.3, 0.75], [0.8, -0.2, 0.75], [0.8, 0.3, 0.75], [0.6, 0.1, 1.05]] {
            let point = pose.inverse() * nalgebra::Point3::from(corner);
            let pixel = camera.intrinsics.project(&point).unwrap();
            let inside = (0.0..640.0).contains(&pixel.x) && (0.0..480.0).contains(&pixel.y);
            assert!(inside, "camera {} sees {corner:?} at {pixel}", camera.name);
        }
    }
}

#[track_caller]
fn check_broken(file: &str, from: &str, to: &str, expected: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    for name in ["curi.urdf", "curi.yaml", "softhand2.yaml", "softhand2_left.urdf", "softhand2_right.urdf"] {
        let text = std::fs::read_to_string(robots_dir().join(name)).unwrap();
        let text = if name == file {
            assert!(text.contains(from), "{file} has no {from:?}");
            text.replacen(from, to, 1)
        } else {
            text
        };
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    let message = RobotModel::load(&dir.path().join("curi.yaml")).unwrap_err().to_string();
    for part in expected {
        assert!(message.contains(part), "{message:?} does not say {part:?}");
    }
}

#[test]
fn mistakes_in_the_files_are_named() {
    check_broken("curi.yaml", "urdf: curi.urdf", "urdf: missing.urdf", &["missing.urdf", "robot description"]);
    check_broken("curi.yaml", "hand_profile:", "hand_profle:", &["curi.yaml", "hand_profle"]);
    check_broken("curi.yaml", "panda_left_joint4: -1", "panda_left_joint4: 1", &["home_q.panda_left_joint4", "limits"]);
    check_broken("curi.yaml", "panda_left_joint1: ", "panda_lft_joint1: ", &["home_q.panda_lft_joint1", "panda_left_joint1"]);
    check_broken("curi.yaml", "max_jerk: [7500.0, ", "max_jerk: [", &["arms.left.max_jerk", "7 positive"]);
    check_broken("curi.yaml", "joints: [panda_left_joint1,", "joints: [] #", &["arms.left.joints", "found none"]);
    check_broken("curi.urdf", "<limit lower=\"-2.8973\"", "<limit lower=\"nan\"", &["curi.urdf", "panda_left_joint1", "NaN"]);
    check_broken("curi.yaml", "mount_link: torso_end", "mount_link: torso", &["cameras.left.mount_link", "torso"]);
    check_broken("curi.urdf", "</robot>", "", &["curi.urdf"]);
    check_broken("curi.urdf", "<parent link=\"base\"/>", "<parent link=\"bse\"/>", &["curi.urdf", "bse"]);
    check_broken("softhand2_left.urdf", "</robot>", "<rob", &["softhand2_left.urdf"]);
}
