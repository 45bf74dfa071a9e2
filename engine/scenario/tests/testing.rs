//! Test files: what a case finds, and every mistake at its place.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod support;

use sfg_scenario::{ScenarioErrors, ScenarioTests};
use sfg_tree::{Action, Halt, Outcome, PortSpec, Progress, Registry, Tick};
use std::fs;
use std::path::Path;
use support::{listed, vocabulary};

const SCENARIO: &str = "\
version: 1
robot: curi
scene: {objects: []}
parameters: {attempts: 2}
blackboard: {n: 1}
tree:
  sequence:
    - look
    - retry:
        attempts: \"${attempts}\"
        on: [slipped]
        do: {sequence: [grasp, lift: {name: up}, fallback: [is_held, lift]]}
    - script: {code: \"n := n + 1\"}
    - show: {width_m: \"{width_m}\"}
subtrees:
  spare: {do: {drop: {name: gently}}}
";

/// An action that no mocked tree starts.
#[derive(Default)]
struct Never;

impl Action<()> for Never {
    fn start(&mut self, _tick: &mut Tick<'_, ()>) -> Outcome {
        Ok(Progress::Running)
    }
    fn poll(&mut self, _tick: &mut Tick<'_, ()>) -> Outcome {
        Ok(Progress::Running)
    }
    fn halt(&mut self, _tick: &mut Tick<'_, ()>) -> Halt {
        Halt::Done
    }
}

fn registry() -> Registry<()> {
    let mut registry = Registry::new();
    registry.step("look", [PortSpec::output::<f64>("width_m")], |_| Ok(()));
    registry.step("show", [PortSpec::setting::<f64>("width_m")], |_| Ok(()));
    registry.condition("is_held", [], |_| Ok(true));
    for name in ["grasp", "lift", "drop"] {
        registry.action(name, [], Never::default);
    }
    registry
}

fn load(scenario: &str, tests: &str) -> Result<ScenarioTests, ScenarioErrors> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.yaml"), scenario).unwrap();
    let path = folder.path().join("a.test.yaml");
    fs::write(&path, tests).unwrap();
    ScenarioTests::load(&path, &registry(), &vocabulary())
}

/// The only case, which has these keys, finds these differences.
#[track_caller]
fn check(case: &str, expected: &[&str]) {
    let text = format!("scenario: a.yaml\ncases:\n  - {{name: it, {case}}}\n");
    let mut tests = load(SCENARIO, &text).unwrap_or_else(|errors| panic!("{errors}"));
    let result = tests.cases.remove(0).run();
    let differences: Vec<String> = result.differences.iter().map(ToString::to_string).collect();
    assert_eq!(differences, expected, "{:?}", result.trace);
}

/// The only case, which has these keys and stands in line 3, has these mistakes.
#[track_caller]
fn refuses(case: &str, expected: &[&str]) {
    refuses_text(&format!("scenario: a.yaml\ncases:\n  - {{name: it, {case}}}\n"), expected);
}

#[track_caller]
fn refuses_text(text: &str, expected: &[&str]) {
    let errors = load(SCENARIO, text).expect_err("the tests are accepted");
    assert_eq!(listed(errors.list()), expected, "{errors}");
}

#[test]
fn a_tree_whose_leaves_all_succeed() {
    check("expect: {status: success, ends_within_secs: 0}", &[]);
    check("expect: {trace: [look, grasp success, up, is_held, show success]}", &[]);
    check("expect: {calls: {lift: 1, grasp: 1, show: 1}, entries: {n: 2}}", &[]);
}

#[test]
fn results_follow_each_other_and_the_last_repeats() {
    let leaves = "leaves: {grasp: [{fails: slipped}, succeeds], up: [{succeeds: {after_secs: 2.0}}]}";
    check(
        &format!("{leaves}, expect: {{status: success, contains: [grasp failure, grasp success, up], calls: {{grasp: 2}}}}"),
        &[],
    );
    // One attempt more comes a tick later, and the lift takes its time.
    check(&format!("{leaves}, expect: {{ends_within_secs: [2.1, 2.1]}}"), &[]);
    check("leaves: {grasp: {fails: slipped}}, expect: {status: failure, reason: slipped, node: grasp, calls: {grasp: 2}}", &[]);
    check("leaves: {grasp: [{fails: lift_failed}]}, expect: {reason: lift_failed, calls: {grasp: 1}}", &[]);
}

#[test]
fn a_path_goes_before_a_name_and_a_name_before_a_kind() {
    let second = "sequence/retry/sequence/fallback/lift";
    let leaves = format!("is_held: [fails], lift: [{{fails: lift_failed}}], {second}: [succeeds]");
    check(
        &format!("leaves: {{{leaves}, up: [succeeds]}}, expect: {{status: success}}")
            .replace("lift: [{fails: lift_failed}], ", ""),
        &[],
    );
    check(&format!("leaves: {{{leaves}}}, expect: {{reason: lift_failed, node: up}}"), &[]);
    check(
        "leaves: {is_held: [fails], up: [succeeds], lift: [{fails: lift_failed}]}, expect: {reason: lift_failed, node: lift}",
        &[],
    );
}

#[test]
fn trees_that_do_not_end_by_themselves() {
    check("leaves: {grasp: [runs]}, until_secs: 3, expect: {status: running, calls: {grasp: 1}}", &[]);
    check(
        "leaves: {grasp: [runs]}, halt_at_secs: 1, expect: {status: halted, contains: [grasp halted], ends_within_secs: [1, 1]}",
        &[],
    );
    check("halt_at_secs: 0, expect: {status: halted, trace: []}", &[]);
}

#[test]
fn entries_and_written_values() {
    check("set_entries: {n: 3}, expect: {entries: {n: 4}}", &[]);
    check("leaves: {look: [{succeeds: {writes: {width_m: 0.08}}}]}, expect: {entries: {width_m: 0.08}}", &[]);
    check("expect: {entries: {width_m: 0.08}}", &["entry width_m: expected 0.08, found nothing that a file can give"]);
    check(
        "leaves: {look: [{succeeds: {writes: {width_m: wide}}}]}, expect: {reason: wrong_type}",
        &[
            "writes: expected values that fit the ports of sequence/look, found port \"width_m\": expected a number, found \"wide\"",
        ],
    );
}

#[test]
fn differences_say_what_was_expected_and_what_was_found() {
    check("expect: {status: failure}", &["status: expected failure, found success"]);
    check("expect: {status: running}", &["status: expected running, found success"]);
    check(
        "leaves: {grasp: [{fails: lift_failed}]}, expect: {reason: slipped, node: up}",
        &[
            "reason: expected slipped, found failure: lift_failed at sequence/retry/sequence/grasp (as the test says)",
            "node: expected up, found sequence/retry/sequence/grasp",
        ],
    );
    check("expect: {reason: slipped}", &["reason: expected slipped, found success"]);
    check("expect: {trace: [look, grasp failure]}", &["trace, item 2: expected grasp failure, found grasp success"]);
    check("expect: {trace: [look]}", &["trace, item 2: expected the end, found grasp success"]);
    check("expect: {trace: [look, grasp, up, is_held, show, look]}", &["trace, item 6: expected look, found the end"]);
    check("expect: {contains: [up, grasp success]}", &["contains: expected grasp success after up, found none"]);
    check(
        "expect: {calls: {grasp: 0}, entries: {n: 7}}",
        &["calls of grasp: expected 0, found 1", "entry n: expected 7, found 2"],
    );
    check("expect: {ends_within_secs: [1, 2]}", &["ends_within_secs: expected 1 to 2 s, found 0.000 s"]);
    check(
        "leaves: {up: [runs]}, until_secs: 1, expect: {ends_within_secs: 2}",
        &["ends_within_secs: expected 0 to 2 s, found running after 1 s"],
    );
}

#[test]
fn names_that_nobody_has_get_the_nearest_one() {
    refuses(
        "leaves: {gras: [succeeds]}, expect: {status: success}",
        &["3:25 the tree has no leaf \"gras\" | did you mean \"grasp\"?"],
    );
    refuses("expect: {trace: [loook success]}", &["3:33 the tree has no leaf \"loook\" | did you mean \"look\"?"]);
    refuses("expect: {trace: [look sucess]}", &["3:33 unknown result \"sucess\" | did you mean \"success\"?"]);
    refuses(
        "expect: {node: retry/sequence}",
        &["3:31 the tree has no node \"retry/sequence\" | did you mean \"sequence/retry/sequence\"?"],
    );
    refuses("expect: {entries: {m: 1}}", &["3:35 the tree does not use blackboard key \"m\" | did you mean \"n\"?"]);
    refuses(
        "set_entries: {nn: 1}, expect: {status: success}",
        &["3:30 the tree does not use blackboard key \"nn\" | did you mean \"n\"?"],
    );
    refuses("expect: {statu: success}", &["3:25 expect has no key \"statu\" | did you mean \"status\"?"]);
    refuses(
        "leaves: {grasp: [{fails: slippd}]}, expect: {status: failure}",
        &["3:41 unknown failure reason \"slippd\" | did you mean \"slipped\"?"],
    );
    refuses(
        "leaves: {grasp: [succeds]}, expect: {status: failure}",
        &["3:33 unknown result \"succeds\" | did you mean \"succeeds\"?"],
    );
    refuses(
        "leaves: {look: [{succeeds: {writes: {width: 1}}}]}, expect: {status: failure}",
        &["3:53 unknown output port \"width\" | known are width_m"],
    );
}

#[test]
fn leaves_that_can_never_run_or_do_what_they_are_told() {
    const LEAVES: &str = "leaves of the tree are look, grasp, up, is_held, lift, show";
    let line = |message: &str| format!("3:25 {message} | {LEAVES}");
    refuses("leaves: {drop: [succeeds]}, expect: {status: success}", &[&line("\"drop\" can never run: it is not in the tree")]);
    refuses(
        "leaves: {gently: [succeeds]}, expect: {status: success}",
        &[&line("\"gently\" can never run: it is not in the tree")],
    );
    refuses(
        "leaves: {script: [succeeds]}, expect: {status: success}",
        &[&line("\"script\" always does the same and cannot be given results")],
    );
    refuses(
        "leaves: {look: [runs, skipped, {succeeds: {after_secs: 1}}]}, expect: {status: success}",
        &[
            "3:32 runs: \"look\" is done within a tick, so it can only succeed or fail at once",
            "3:38 skipped: \"look\" is done within a tick, so it can only succeed or fail at once",
            "3:71 after_secs: \"look\" is done within a tick, so it can only succeed or fail at once",
        ],
    );
    refuses(
        "leaves: {grasp: [fails]}, expect: {status: failure}",
        &["3:33 \"grasp\" fails for no reason | write `fails: reason`"],
    );
    refuses("leaves: {grasp: [{succeeds: {writes: {a: 1}}}]}, expect: {status: success}", &["3:54 \"grasp\" writes nothing"]);
    refuses(
        "leaves: {sequence/look: [succeeds], look: [succeeds]}, expect: {status: success}",
        &["3:52 nobody takes the results of \"look\": all that is called so has more exact ones | remove them"],
    );
}

#[test]
fn expectations_that_make_no_sense() {
    refuses("leaves: {}", &["3:6 case needs key \"expect\""]);
    refuses(
        "expect: {}",
        &[
            "3:24 the case expects nothing | say what is expected: status, reason, node, trace, contains, calls, ends_within_secs, entries",
        ],
    );
    refuses("expect: {status: success, reason: slipped}", &["3:42 reason: only a failure has one, and the case expects success"]);
    refuses("expect: {status: halted}", &["3:33 nothing halts the tree | give the case `halt_at_secs`"]);
    refuses("expect: {contains: []}", &["3:35 contains: the list is empty"]);
    refuses("expect: {calls: {grasp: -1}}", &["3:40 calls: expected a whole number from 0 to 4294967295, found -1"]);
    refuses("expect: {ends_within_secs: soon}", &["3:43 ends_within_secs: expected a number or [min, max], found \"soon\""]);
    refuses(
        "until_secs: 5, halt_at_secs: 6, expect: {status: halted}",
        &["3:45 halt_at_secs: the case ends after 5 s, before anything is halted | give `until_secs` more, or this less"],
    );
    refuses_text(
        "scenario: a.yaml\ntick_secs: 0.01\ncases: [{name: a, until_secs: 86400, expect: {status: success}}]\n",
        &["3:31 86400 s are more than 1000000 ticks | give `until_secs` less, or `tick_secs` more"],
    );
}

#[test]
fn the_file_around_the_cases() {
    refuses_text("", &["1:1 the test file is empty | it needs scenario, cases"]);
    refuses_text("scenario: a.yaml\ncases: []\n", &["2:8 there are no cases | write at least one: `- name: ...`"]);
    refuses_text("scenario: a.yaml\n", &["1:1 test file needs key \"cases\""]);
    refuses_text(
        "scenario: b.yaml\ncases: [{name: a, expect: {status: success}}]\n",
        &["1:11 cannot read \"b.yaml\": No such file or directory (os error 2) | the path is relative to the test file"],
    );
    refuses_text(
        "scenario: a.yaml\ncases:\n  - {name: a, expect: {status: success}}\n  - {name: a, expect: {status: success}}\n",
        &["4:12 two cases are called \"a\" | the first is in line 3"],
    );
    let cases = "cases: [{name: a, expect: {status: success}}]\n";
    refuses_text(
        &format!("scenario: a.yaml\nset: {{atempts: 3}}\n{cases}"),
        &["2:7 the scenario has no parameter \"atempts\" | did you mean \"attempts\"?"],
    );
    refuses_text(
        &format!("scenario: a.yaml\ntick_secs: 0\n{cases}"),
        &["2:12 tick_secs: expected a number from 0.001 to 10, found 0"],
    );
    load(SCENARIO, &format!("scenario: a.yaml\nset: {{attempts: 5}}\n{cases}")).unwrap();
}

#[test]
fn entries_of_a_wrong_type_are_refused_where_they_are_set() {
    let errors =
        load(SCENARIO, "scenario: a.yaml\ncases:\n  - {name: a, set_entries: {width_m: wide}, expect: {status: success}}\n");
    let listed = listed(errors.unwrap_err().list());
    assert!(listed.len() == 1 && listed[0].starts_with("3:38 ") && listed[0].contains("found \"wide\""), "{listed:?}");
}

#[test]
fn mistakes_of_the_scenario_are_shown_in_its_file() {
    let errors = load(&SCENARIO.replace("- look", "- lok"), "scenario: a.yaml\ncases: [{nam: a}]\n").unwrap_err();
    assert_eq!(
        listed(errors.list()),
        [
            "2:9 case needs key \"name\"",
            "2:9 case needs key \"expect\"",
            "2:10 case has no key \"nam\" | did you mean \"name\"?",
            "1:8:7 unknown node \"lok\" | did you mean \"look\"?",
        ]
    );
    assert!(errors.to_string().contains("a.yaml:8:7"), "{errors}");
}

#[test]
fn a_path_without_a_folder_is_enough() {
    let text = "scenario: nowhere.yaml\ncases: [{name: a, expect: {status: success}}]\n";
    let errors = ScenarioTests::parse(Path::new("a.test.yaml"), text.to_owned(), &registry(), &vocabulary()).unwrap_err();
    assert!(errors.to_string().contains("cannot read \"nowhere.yaml\""), "{errors}");
}

/// Letters lost, doubled and swapped, lines lost and moved: whatever comes out is read or refused.
#[test]
fn damaged_files_never_panic_and_never_take_long() {
    use rand::{Rng, SeedableRng};
    let tests = "scenario: a.yaml\nset: {attempts: 3}\ntick_secs: 0.1\ncases:\n  - name: it\n    leaves:\n      grasp: \
                 [{fails: {reason: slipped, after_secs: 1}}, succeeds, skipped, runs]\n      look: [{succeeds: {writes: {width_m: 1}}}]\n    \
                 set_entries: {n: 3}\n    halt_at_secs: 5\n    until_secs: 60\n    expect:\n      status: halted\n      trace: [look, \
                 grasp failure]\n      calls: {grasp: 1}\n      ends_within_secs: [0, 5]\n      entries: {n: 4}\n";
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.yaml"), SCENARIO).unwrap();
    let path = folder.path().join("a.test.yaml");
    let (registry, vocabulary) = (registry(), vocabulary());
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let load = |text: String| ScenarioTests::parse(&path, text, &registry, &vocabulary);
    load(tests.to_owned()).unwrap_or_else(|errors| panic!("{errors}"));
    let mut n_accepted = 0;
    for _ in 0..2000 {
        let mut letters: Vec<char> = tests.chars().collect();
        for _ in 0..random.random_range(1..4) {
            let (a, b) = (random.random_range(0..letters.len()), random.random_range(0..letters.len()));
            match random.random_range(0..4) {
                0 => drop(letters.remove(a)),
                1 => letters.insert(a, letters[b]),
                2 => letters.swap(a, b),
                _ => letters.insert(a, ['{', '}', '[', '\n', '&', '*', '"', '\u{0}'][b % 8]),
            }
        }
        let begun = std::time::Instant::now();
        n_accepted += usize::from(load(letters.into_iter().collect()).is_ok());
        assert!(begun.elapsed().as_secs() < 1);
    }
    assert!(n_accepted < 1000, "{n_accepted} of 2000 damaged files are accepted");
}
