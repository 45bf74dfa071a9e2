//! `sfg robot` and `sfg ik`.

use crate::{folder, read_json, sfg};

#[test]
fn a_robot_is_described() {
    let folder = folder();
    let said = sfg(folder.path(), &["robot", "info"]).ended_with(0).stdout;
    for part in
        ["panda_left_joint4", "-3.0718", "torso_joint5", "-1.000 x torso_actuated_joint2", "right arm: 7 joints", "camera left:"]
    {
        assert!(said.contains(part), "{part:?} is not in:\n{said}");
    }
    sfg(folder.path(), &["robot", "info", "cury"]).refused(2, &["\"cury\" is neither a robot", "did you mean \"curi\"?"]);
}

#[test]
fn a_palm_pose_becomes_joint_angles_or_the_nearest_miss() {
    let folder = folder();
    let pose = ["robot", "ik", "--xyz-m", "0.8", "0.2", "0.9", "--rpy-deg", "0", "90", "0"];
    let said = sfg(folder.path(), &pose).ended_with(0).stdout;
    assert!(said.lines().filter(|line| line.starts_with("panda_left_joint")).count() == 7, "{said}");
    sfg(folder.path(), &["robot", "ik", "--xyz-m", "3", "0", "1"]).refused(2, &["the nearest misses it by", "mm and"]);
    sfg(folder.path(), &["robot", "ik", "--xyz-m", "nan", "0", "1"]).refused(2, &["finite"]);
    let unknown = ["robot", "ik", "--base", "base", "--tip", "left_plam", "--xyz-m", "0", "0", "1"];
    sfg(folder.path(), &unknown).refused(2, &["left_plam", "left_palm"]);
}

#[test]
fn inverse_kinematics_is_measured_the_same_way_each_time() {
    let folder = folder();
    let solved = |name: &str| {
        sfg(folder.path(), &["ik", "bench", "--n", "200", "--seed", "7", "--within-ms", "1000", "--json", name]).ended_with(0);
        let all = read_json(&folder.path().join(name));
        let all = all.as_array().unwrap().clone();
        all.into_iter()
            .map(|one| (one["is_solved"].as_bool().unwrap(), one["iterations"].as_u64(), one["position_miss_m"].as_f64()))
    };
    let first: Vec<_> = solved("a.json").collect();
    assert!(first.len() == 200 && first.iter().filter(|one| one.0).count() >= 199, "{first:?}");
    assert!(solved("b.json").eq(first));
    sfg(folder.path(), &["ik", "bench", "--n", "0"]).refused(2, &["--n 0"]);
}
