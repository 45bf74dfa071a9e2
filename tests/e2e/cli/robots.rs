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

#[test]
fn a_map_of_reach_is_built_asked_drawn_and_checked() {
    let folder = folder();
    let refused = ["robot", "reach", "at", "--map", "left.reach", "--xyz-m", "0.8", "0.2", "0.9"];
    sfg(folder.path(), &refused).refused(2, &["there is no map left.reach", "sfg robot reach build"]);
    let build = ["robot", "reach", "build", "--resolution-m", "0.25", "--map", "left.reach"];
    let said = sfg(folder.path(), &build).ended_with(0).stdout;
    assert!(said.contains("cells reached") && !folder.path().join("left.reach-build").exists(), "{said}");
    let at = |xyz: [&str; 3]| {
        let mut args = vec!["robot", "reach", "at", "--map", "left.reach", "--rpy-deg", "0", "90", "0", "--xyz-m"];
        args.extend(xyz);
        sfg(folder.path(), &args)
    };
    let said = at(["0.8", "0.2", "0.9"]).ended_with(0).stdout;
    assert!(said.starts_with("reachable, score"), "{said}");
    at(["1.3", "0.2", "0.9"]).refused(2, &["not reachable, score"]);
    at(["3", "0", "1"]).refused(2, &["not reachable, score 0: no palm pose about it is"]);
    let said = sfg(folder.path(), &["robot", "reach", "check", "--map", "left.reach", "--n", "300"]).ended_with(0).stdout;
    assert!(said.contains("verdicts that agree: ") && said.contains("95 % interval"), "{said}");
    sfg(folder.path(), &["robot", "reach", "slice", "--map", "left.reach", "--height-m", "0.9"]).ended_with(0);
    assert!(std::fs::read(folder.path().join("reach.png")).unwrap().starts_with(b"\x89PNG"));
    sfg(folder.path(), &["robot", "reach", "slice", "--map", "left.reach", "--height-m", "9"]).refused(2, &["outside the map"]);
    sfg(folder.path(), &["robot", "reach", "slice", "--map", "left.reach", "--arm", "right", "--height-m", "1"])
        .refused(2, &["was built for another arm", "build it again"]);
    sfg(folder.path(), &["robot", "reach", "build", "--resolution-m", "0"]).refused(2, &["--resolution-m"]);
}

/// The shared scenario up to the choice of the palm pose, with the bottle at the far right of the left arm: nothing moves.
fn far_right() -> String {
    let text = include_str!("../scenarios/lift.yaml").replace("x_m: 0.80, y_m: 0.30", "x_m: 0.80, y_m: -0.50");
    let (before, after) = text.split_once("        - synthesize_grasp\n").unwrap();
    format!("{before}success:{}", after.split_once("success:").unwrap().1)
}

#[test]
fn a_run_chooses_the_same_palm_pose_with_a_map_and_refuses_one_that_does_not_fit() {
    let folder = folder();
    let assets = folder.path().join("assets");
    for part in ["robots", "objects"] {
        let from = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios").join(part);
        std::fs::create_dir_all(assets.join(part)).unwrap();
        for file in std::fs::read_dir(from).unwrap().map(Result::unwrap).filter(|file| file.path().is_file()) {
            std::fs::copy(file.path(), assets.join(part).join(file.file_name())).unwrap();
        }
    }
    let map = assets.join("robots/curi.left.reach");
    let _unused = std::fs::remove_file(&map);
    std::fs::write(folder.path().join("right.yaml"), far_right()).unwrap();
    let instruction = ["--instruction", "Pick up the blue glass."];
    let selected = |out: &str| {
        let args = ["--assets", "assets", "run", "right.yaml", "--no-recording", "--out", out];
        sfg(folder.path(), &[&args[..], &instruction[..]].concat());
        let report = read_json(&folder.path().join(out).join("report.json"));
        let stages = report["stages"].as_array().unwrap();
        stages.iter().find(|stage| stage["stage"] == "select_palm_pose").unwrap()["details"].clone()
    };
    let without = selected("without");
    sfg(folder.path(), &["--assets", "assets", "robot", "reach", "build", "--resolution-m", "0.25"]).ended_with(0);
    let with = selected("with");
    assert!(without["reach_scores"].is_null() && without["chosen"].as_u64().unwrap() > 0, "{without}");
    let scores = with["reach_scores"].as_array().unwrap();
    let n_better = with["chosen"].as_u64().unwrap() as usize;
    assert!(scores[..n_better].iter().any(|score| score == 0.0), "some better palm pose is hopeless: {scores:?}");
    assert_eq!((&with["chosen"], &with["candidate"]), (&without["chosen"], &without["candidate"]));
    let whys = |details: &serde_json::Value| {
        let rejected = details["rejected"].as_array().unwrap();
        rejected.iter().map(|one| (one["candidate_idx"].clone(), one["reason"]["why"].clone())).collect::<Vec<_>>()
    };
    assert_eq!(whys(&with), whys(&without));
    assert!(!with["rejected"][0]["reason"]["at_limit"].as_array().unwrap().is_empty(), "{}", with["rejected"][0]);
    let description = std::fs::read_to_string(assets.join("robots/curi.yaml")).unwrap();
    std::fs::write(assets.join("robots/curi.yaml"), description.replacen("xyz: [0.046,", "xyz: [0.056,", 1)).unwrap();
    sfg(folder.path(), &["--assets", "assets", "run", "right.yaml", "--out", "stale"])
        .refused(2, &["curi.left.reach", "was built for another arm", "sfg robot reach build"]);
}

#[test]
fn a_robot_of_boxes_and_meshes_is_covered_with_balls() {
    let folder = folder();
    let link = |name: &str, geometry: &str| {
        let collision = format!("<collision><origin xyz='0 0 0.1'/><geometry>{geometry}</geometry></collision>");
        format!("<link name='{name}'>{collision}</link>")
    };
    let joint = "<joint name='turn' type='revolute'><parent link='base'/><child link='arm'/><axis xyz='0 0 1'/>\
                 <limit lower='-1' upper='1' velocity='1' effort='1'/></joint>";
    let urdf = |mesh: &str| {
        let mesh = format!("<mesh filename='{mesh}' scale='0.001 0.001 0.001'/>");
        format!("<robot name='r'>{}{}{joint}</robot>", link("base", "<box size='0.2 0.1 0.1'/>"), link("arm", &mesh))
    };
    // A corner of a cube, in millimetres.
    let corners = [[0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100]];
    let mut stl = "solid corner\n".to_owned();
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        let vertex = |idx: usize| corners[idx].map(|v: i32| v.to_string()).join(" ");
        let [a, b, c] = face.map(vertex);
        stl += &format!("facet normal 0 0 0\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet\n");
    }
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("corner.stl", &(stl + "endsolid corner\n"));
    write("robot.urdf", &urdf("corner.stl"));
    let said = sfg(folder.path(), &["robot", "spheres", "robot.urdf", "--excess-m", "0.02", "--out", "balls.urdf"]).ended_with(0);
    let rows: Vec<&str> = said.stdout.lines().filter(|line| line.starts_with("base ") || line.starts_with("arm ")).collect();
    assert!(rows.len() == 2 && rows.iter().all(|row| row.contains("100.00 %")), "{}", said.stdout);
    assert!(said.stdout.contains("link1=\"base\" link2=\"arm\""), "{}", said.stdout);
    let few =
        sfg(folder.path(), &["robot", "spheres", "robot.urdf", "--count", "4", "--compare", "balls.urdf"]).ended_with(0).stdout;
    let total = |text: &str, nth: usize| {
        let row = text.lines().filter(|line| line.starts_with("all ")).nth(nth).unwrap().to_owned();
        row.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap()
    };
    assert!(total(&few, 0) <= 4 && total(&few, 1) == total(&said.stdout, 0), "{few}");
    let again = sfg(folder.path(), &["robot", "info", "balls.urdf"]).ended_with(0).stdout;
    assert!(again.contains(&format!("{} collision shapes", total(&said.stdout, 0))), "{again}");

    sfg(folder.path(), &["robot", "spheres", "robot.urdf", "--count", "1"]).refused(2, &["--count 1", "at least 2"]);
    sfg(folder.path(), &["robot", "spheres", "robot.urdf", "--excess-m", "0"]).refused(2, &["--excess-m 0"]);
    write("lost.urdf", &urdf("package://parts/corner.stl"));
    sfg(folder.path(), &["robot", "spheres", "lost.urdf"]).refused(2, &["link \"arm\"", "--package parts=FOLDER"]);
    write("empty.stl", "solid nothing\nendsolid nothing\n");
    write("empty.urdf", &urdf("empty.stl"));
    sfg(folder.path(), &["robot", "spheres", "empty.urdf"]).refused(2, &["empty.stl", "no triangle with an area"]);
    write("text.stl", "this is no mesh");
    write("text.urdf", &urdf("text.stl"));
    sfg(folder.path(), &["robot", "spheres", "text.urdf"]).refused(2, &["link \"arm\"", "text.stl"]);
}

#[test]
fn hostile_commands_are_sent_through_the_safety_filter_and_judged() {
    let folder = folder();
    let args = ["safety", "bench", "--n", "8", "--plans", "1", "--secs", "0.1", "--json", "out.json"];
    let said = sfg(folder.path(), &args).ended_with(0).stdout;
    assert!(said.contains("8 hostile trajectories of 0.1 s") && said.contains("distance): 0 (95 % interval"), "{said}");
    let figures = read_json(&folder.path().join("out.json"));
    let hostile = figures["hostile"].as_array().unwrap();
    let kinds: std::collections::BTreeSet<&str> = hostile.iter().map(|one| one["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds.len(), 8, "{kinds:?}");
    assert!(hostile.iter().filter(|one| one["n_interventions"].as_u64().unwrap() > 0).count() >= 6, "{figures}");
    assert_eq!(figures["planned"].as_array().unwrap().len(), 1);
    sfg(folder.path(), &["safety", "bench", "--secs", "0"]).refused(2, &["--secs 0", "expected more than 0"]);
    sfg(folder.path(), &["safety", "bench", "--robot", "curry"]).refused(2, &["no robot is called \"curry\"", "curi"]);
}
