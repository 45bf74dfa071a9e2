//! A coarse map of the shipped robot's left arm: what it says, its file, and what is refused.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use nalgebra::{Quaternion, Unit, Vector3, Vector4};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::reach::{ReachBuild, ReachCount, ReachMap, ReachSettings, better_arm};
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, RobotModel};
use sfg_types::{HandSide, Point, Pose};
use std::path::Path;
use std::sync::OnceLock;

fn curi() -> &'static RobotModel {
    static CURI: OnceLock<RobotModel> = OnceLock::new();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml");
    CURI.get_or_init(|| RobotModel::load(&path).unwrap())
}

fn chain(side: HandSide) -> &'static Chain {
    curi().arm_chain(side)
}

/// Five times as coarse as the maps that are used: built in a moment.
fn begun(side: HandSide) -> ReachBuild {
    ReachBuild::new(chain(side), "curi", side.name(), &ReachSettings { resolution_m: 0.25, seed: 3 })
}

fn built(side: HandSide) -> ReachMap {
    let mut build = begun(side);
    while !build.is_done() {
        build.pass(chain(side), &|| ());
    }
    build.finish().unwrap()
}

fn left() -> &'static ReachMap {
    static LEFT: OnceLock<ReachMap> = OnceLock::new();
    LEFT.get_or_init(|| built(HandSide::Left))
}

/// Anywhere in the map's box, turned anyhow.
fn random_pose(map: &ReachMap, chain: &Chain, rng: &mut ChaCha8Rng) -> Pose {
    let corners = map.box_in_base(chain);
    let shares = Vector3::from_fn(|_, _| rng.random_range(0.0..1.0));
    // The box's edges leave its first corner towards the corners 1, 2 and 4.
    let place = [1, 2, 4].iter().zip(shares.iter()).fold(corners[0], |at, (corner, s)| at + (corners[*corner] - corners[0]) * *s);
    let turn = loop {
        let q = Vector4::from_fn(|_, _| rng.random_range(-1.0..1.0));
        if (0.1..1.0).contains(&q.norm()) {
            break Unit::new_normalize(Quaternion::from(q));
        }
    };
    Pose::from_parts(place.into(), turn)
}

#[test]
fn the_verdict_is_that_of_inverse_kinematics_and_reachable_comes_with_a_configuration() {
    let (map, chain) = (left(), chain(HandSide::Left));
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (n, mut n_reachable, mut n_false, mut n_missed) = (600, 0, 0, 0);
    let settings = IkSettings::default();
    for _ in 0..n {
        let pose = random_pose(map, chain, &mut rng);
        let verdict = map.verdict(chain, &pose);
        assert!((0.0..=1.0).contains(&verdict.score) && (verdict.score - map.score(chain, &pose)).abs() < 1e-12);
        if let Some(IkOutcome::Solved { q, .. }) = &verdict.outcome {
            let miss = pose.inverse() * chain.fk(q);
            assert!(miss.translation.vector.norm() <= 1.001e-3 && miss.rotation.angle() <= 3.01e-3, "{miss}");
            assert!(chain.is_inside_limits(q, 0.0));
        }
        let exact = IkSolver::solve(chain, &pose, &chain.middle(), &settings, &mut rng);
        let is_solved = matches!(exact, IkOutcome::Solved { .. });
        n_reachable += usize::from(is_solved);
        n_false += usize::from(verdict.is_reachable() && !is_solved);
        n_missed += usize::from(!verdict.is_reachable() && is_solved);
    }
    // Here 25 cm; a map of 5 cm is nearer.
    assert!(n_reachable > 60 && n_reachable < 300, "{n_reachable}");
    assert!(n_false <= 3 && n_missed <= 12, "of {n}: {n_false} falsely reachable, {n_missed} missed");
}

#[test]
fn what_is_outside_is_hopeless_and_what_is_far_inside_scores_high() {
    let (map, chain) = (left(), chain(HandSide::Left));
    for far in [5.0, 1e300, f64::NAN, f64::INFINITY] {
        let verdict = map.verdict(chain, &Pose::translation(far, 0.0, 0.0));
        assert!(verdict.outcome.is_none() && verdict.score == 0.0 && !verdict.is_reachable());
        assert_eq!(map.share_at(chain, &Point::new(far, 0.0, 0.0)), 0.0);
    }
    let home = map.verdict(chain, &chain.fk(&curi().arm(HandSide::Left).home_q));
    assert!(home.is_reachable() && home.score > 0.5, "{home:?}");
    let share = map.share_at(chain, &(chain.fk(&chain.middle()) * Point::origin()));
    assert!(share > 0.2 && share <= 1.0, "{share}");
}

#[test]
fn a_moved_torso_needs_no_new_map_and_another_arm_does() {
    let model = curi();
    let mut q = model.home_q.clone();
    q[model.tree.q_idx("torso_actuated_joint2").unwrap()] += 0.4;
    let arm = model.arm(HandSide::Left);
    let base = &model.tree.links[0].name;
    let leaning = Chain::new(&model.tree, base, &arm.tip_link, &arm.chain.joint_names, &q).unwrap();
    assert!(left().is_of(&arm.chain) && left().is_of(&leaning));
    assert!(!left().is_of(chain(HandSide::Right)) && !left().is_of(&arm.chain.with_tip(&Pose::translation(0.0, 0.0, 0.01))));
    // The same configurations reach with the torso at another place.
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let n_reached =
        (0..200).filter(|_| left().verdict(&leaning, &leaning.fk(&random_q(&leaning, &mut rng))).is_reachable()).count();
    assert!(n_reached > 185, "{n_reached}");
}

#[test]
fn any_number_of_threads_and_a_killed_build_give_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, resumed) = (folder.path().join("whole.reach"), folder.path().join("resumed.reach"));
    left().save(&whole).unwrap();
    let chain = chain(HandSide::Left);
    begun(HandSide::Left).save(&resumed).unwrap();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    // Killed after each pass.
    loop {
        let mut build = ReachBuild::resume(&resumed, chain).unwrap();
        alone.install(|| build.pass(chain, &|| ()));
        build.save(&resumed).unwrap();
        if build.is_done() {
            break;
        }
        let message = ReachMap::load(&resumed, chain).unwrap_err().to_string();
        assert!(message.contains("its build stopped after pass") && message.contains("sfg robot reach build"), "{message}");
    }
    assert!(std::fs::read(&whole).unwrap() == std::fs::read(&resumed).unwrap(), "the files differ");
    assert_eq!(&ReachMap::load(&whole, chain).unwrap(), left());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing else is left behind");
}

#[test]
fn a_file_that_is_foreign_short_damaged_or_no_map_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left.reach");
    left().save(&path).unwrap();
    let good = std::fs::read(&path).unwrap();
    let chain = chain(HandSide::Left);
    let check = |bytes: &[u8], expected: &str| {
        std::fs::write(&path, bytes).unwrap();
        let message = ReachMap::load(&path, chain).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("left.reach"), "{expected}: {message}");
    };
    for length in [0, 5, 12, 20, 300, good.len() / 2, good.len() - 1] {
        let expected = if length < 12 { "is no reachability map" } else { "is cut short" };
        check(&good[..length], expected);
    }
    check(b"solid teapot\nfacet normal 0 0 1\n", "is no reachability map");
    check(&[b"sfg-reach 2\n".as_slice(), &good[12..]].concat(), "has version 2, this program reads 1");
    for at in [40, 1000, good.len() - 40, good.len() - 1] {
        let mut bytes = good.clone();
        bytes[at] ^= 0x20;
        std::fs::write(&path, &bytes).unwrap();
        assert!(ReachMap::load(&path, chain).unwrap_err().to_string().contains("damaged"), "byte {at}");
    }
    check(&[good.as_slice(), b"more"].concat(), "damaged");
    // A header that asks for more than there is asks in vain.
    let text = String::from_utf8_lossy(&good[..400]).into_owned();
    let huge = text.replace("\"size\":[", "\"size\":[4000000000,4000000000,4000000000,").replace(",4000000000,", ",");
    check(huge.as_bytes(), "damaged");
    std::fs::write(&path, &good).unwrap();
    let message = ReachMap::load(&path, self::chain(HandSide::Right)).unwrap_err().to_string();
    assert!(message.contains("was built for another arm") && message.contains("\"curi\""), "{message}");
    let absent = ReachMap::load(&folder.path().join("absent.reach"), chain).unwrap_err().to_string();
    assert!(absent.contains("absent.reach"), "{absent}");
    assert!(left().save(&folder.path().join("no/such/folder.reach")).unwrap_err().to_string().contains("cannot write"));
}

#[test]
fn the_arm_on_its_own_side_reaches_more() {
    let right = built(HandSide::Right);
    let (left_chain, right_chain) = (chain(HandSide::Left), chain(HandSide::Right));
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    // The palm's rotation of each ready pose, over a patch on the left and one on the right.
    let homes = [HandSide::Left, HandSide::Right].map(|side| chain(side).fk(&curi().arm(side).home_q).rotation);
    let mut side_of = |y_m: f64| {
        let places: Vec<Vector3<f64>> =
            (0..40).map(|_| Vector3::new(rng.random_range(0.5..0.9), y_m + rng.random_range(-0.1..0.1), 0.9)).collect();
        let [for_left, for_right] =
            homes.map(|home| places.iter().map(|at| Pose::from_parts((*at).into(), home)).collect::<Vec<_>>());
        let by_map =
            better_arm(&ReachCount::by_map(left(), left_chain, &for_left), &ReachCount::by_map(&right, right_chain, &for_right));
        let settings = IkSettings { max_starts: 30, ..IkSettings::default() };
        let by_ik = better_arm(
            &ReachCount::by_ik(left_chain, &for_left, &settings, &mut rng),
            &ReachCount::by_ik(right_chain, &for_right, &settings, &mut rng),
        );
        assert_eq!(by_map, by_ik, "map and inverse kinematics at y = {y_m} m");
        by_map
    };
    assert_eq!(side_of(0.55), Some(HandSide::Left));
    assert_eq!(side_of(-0.55), Some(HandSide::Right));
    assert_eq!(side_of(9.0), None);
}

#[test]
fn more_reached_poses_count_before_better_ones() {
    let count = |n_reached, score| ReachCount { n_reached, score };
    assert_eq!(better_arm(&count(3, 0.5), &count(2, 2.0)), Some(HandSide::Left));
    assert_eq!(better_arm(&count(2, 0.5), &count(2, 0.7)), Some(HandSide::Right));
    assert_eq!(better_arm(&count(2, 0.5), &count(2, 0.5)), Some(HandSide::Left));
    assert_eq!(better_arm(&count(0, 0.0), &count(0, 0.0)), None);
}
