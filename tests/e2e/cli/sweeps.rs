//! Sweeps: shards in any order give what one command gives, and nothing foreign gets in.

use crate::{folder, read_json, repository, sfg, start, text, without};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A merged result without what the wall clock and the cut into shards put in.
fn outcome(path: &Path) -> Value {
    let mut result = without(read_json(path), &["job", "median_decision_secs", "median_wall_secs"]);
    for unit in result["units"].as_array_mut().unwrap() {
        *unit = without(unit.take(), &["decision_secs", "wall_secs"]);
    }
    result
}

#[test]
fn shards_give_what_one_sweep_gives() {
    let folder = folder();
    let here = folder.path();
    let scenario = repository("scenarios/00_move_joints.yaml");
    let sweep = ["sweep", text(&scenario), "--seeds", "1..4", "--work", "whole", "--jobs", "1", "--json", "whole.json"];
    #[cfg(unix)]
    interrupt_after_a_part(here, &sweep);
    sfg(here, &sweep).ended_with(0);
    let whole = outcome(&here.join("whole.json"));
    assert_eq!((&whole["n_trials"], &whole["n_successes"]), (&4.into(), &4.into()));
    let seeds: Vec<&Value> = whole["units"].as_array().unwrap().iter().map(|unit| &unit["seed"]).collect();
    assert_eq!(seeds, [1, 2, 3, 4]);

    let plan = sfg(here, &["shard", "plan", text(&scenario), "--seeds", "1..4", "--work", "job", "--per-shard", "2"]);
    assert!(plan.ended_with(0).stdout.contains("4 seeds in 2 shards"));
    let run_shard =
        |shard: &str| start(here, &["shard", "run-shard", "--job", "job/job.json", "--shard", shard, "--out", "parts"], &[]);
    let merge = |json: &str| sfg(here, &["shard", "merge", "--job", "job/job.json", "--out", "parts", "--json", json]);

    // The second shard first; the first one is killed on its way and leaves no part.
    run_shard("1").wait().ended_with(0);
    let mut killed = run_shard("0");
    std::thread::sleep(std::time::Duration::from_millis(100));
    killed.child.kill().unwrap();
    killed.child.wait().unwrap();
    assert!(!here.join("parts/part-00000.json").exists());
    merge("early.json").refused(5, &["part-00000.json is missing; run shard 0"]);
    assert!(!here.join("early.json").exists());
    run_shard("0").wait().ended_with(0);
    merge("merged.json").ended_with(0);
    assert_eq!(outcome(&here.join("merged.json")), whole);

    // A part that was lost is made again.
    fs::remove_file(here.join("parts/part-00001.json")).unwrap();
    run_shard("1").wait().ended_with(0);
    merge("again.json").ended_with(0);
    assert_eq!(outcome(&here.join("again.json")), whole);

    // A part of another job, a shard beyond the last and a plan changed by hand are refused.
    sfg(here, &["shard", "plan", text(&scenario), "--seeds", "5..8", "--work", "other", "--per-shard", "2"]).ended_with(0);
    let other = ["--job", "other/job.json", "--out", "parts"];
    let belongs = ["part-00000.json belongs to another job"];
    sfg(here, &[&["shard", "run-shard", "--shard", "0"], &other[..]].concat()).refused(2, &belongs);
    sfg(here, &[&["shard", "merge"], &other[..]].concat()).refused(2, &belongs);
    run_shard("2").wait().refused(2, &["shard 2 of a job with 2 shards"]);
    let job = fs::read_to_string(here.join("job/job.json")).unwrap();
    fs::write(here.join("job/job.json"), job.replace("\"seeds_per_shard\": 2", "\"seeds_per_shard\": 1")).unwrap();
    run_shard("0").wait().refused(2, &["job/job.json was changed by hand; plan again"]);
}

/// Ctrl-C keeps the parts that are there, and they are taken over by the next call.
#[cfg(unix)]
fn interrupt_after_a_part(here: &Path, sweep: &[&str]) {
    let mut started = start(here, sweep, &[]);
    let first_part = || {
        let jobs = fs::read_dir(here.join("whole")).into_iter().flatten();
        jobs.map(|job| job.unwrap().path().join("part-00000.json")).find(|part| part.exists())
    };
    let part = loop {
        assert!(started.child.try_wait().unwrap().is_none(), "the sweep ended by itself");
        match first_part() {
            Some(part) => break part,
            None => std::thread::sleep(std::time::Duration::from_millis(5)),
        }
    };
    started.signal("INT");
    started.wait().refused(130, &["interrupted", "the same command goes on"]);
    assert!(!here.join("whole.json").exists());
    let before = fs::read(&part).unwrap();
    sfg(here, sweep).ended_with(0);
    assert_eq!(fs::read(&part).unwrap(), before, "a part that was there was run again");
}

#[test]
fn a_scenario_that_changed_after_the_plan_is_refused() {
    let folder = folder();
    let here = folder.path();
    let scenario = fs::read_to_string(repository("scenarios/00_move_joints.yaml")).unwrap();
    fs::write(here.join("a.yaml"), &scenario).unwrap();
    sfg(here, &["shard", "plan", "a.yaml", "--seeds", "1..1", "--work", "job"]).ended_with(0);
    fs::write(here.join("a.yaml"), scenario.replace("speed: 0.3", "speed: 0.4")).unwrap();
    let ended = sfg(here, &["shard", "run-shard", "--job", "job/job.json", "--shard", "0", "--out", "parts"]);
    ended.refused(2, &["a.yaml is not what the job was planned with; plan again"]);
    assert!(!here.join("parts").exists());
}

#[test]
fn ranges_that_make_no_sense_are_refused() {
    let folder = folder();
    let scenario = repository("scenarios/00_move_joints.yaml");
    let check = |args: &[&str], said: &str| sfg(folder.path(), &[&["sweep", text(&scenario)], args].concat()).refused(2, &[said]);
    check(&[], "give --seeds A..B or --seeds-from-commit N");
    check(&["--seeds", "5..1"], "--seeds \"5..1\" is no range; write for example 1..20");
    check(&["--seeds", "0..18446744073709551615"], "at most 1000000 seeds");
    sfg(folder.path(), &["sweep", "nowhere.yaml", "--seeds", "1..1"]).refused(2, &["cannot read \"nowhere.yaml\""]);
}
