//! What can be done with a tree that runs: replay, save and resume, reload, threads, the blackboard from outside.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod support;

use sfg_tree::{
    Action, Conflict, EditError, Failure, Halt, JournalLevel, Literal, MockResult, Mocks, NamedRecord, NodeSpec, Outcome,
    PortSpec, Progress, Queue, Registry, ResumeError, Statistics, Status, Tick, Tree, TreeSpec, TreeState, When, reason, replay,
};
use std::time::Duration;
use support::{Events, parse, registry};

fn build(text: &str) -> Tree<Events> {
    registry().build(&TreeSpec::new(parse(text))).unwrap()
}

/// The same steps for everybody: ticks, a second apart, and now and then a halt.
fn step(tree: &mut Tree<Events>, step_idx: u32, next: &mut impl FnMut(u64) -> u64) -> (Status, Events) {
    let mut events = Events::new();
    if next(8) == 0 {
        tree.halt(&mut events);
        return (Status::Idle, events);
    }
    (tree.tick(f64::from(step_idx), &mut events), events)
}

fn record(text: &str, seed: u64) -> Vec<NamedRecord> {
    let mut tree = build(text);
    tree.set_journal_level(JournalLevel::Values);
    let names = tree.names();
    let mut next = support::numbers(seed);
    for step_idx in 0..30 {
        step(&mut tree, step_idx, &mut next);
    }
    tree.drain_journal().into_iter().map(|record| names.of(record)).collect()
}

#[test]
fn a_replay_of_the_same_tree_never_diverges() {
    for seed in 1..=300 {
        let text = support::random_tree(&mut support::numbers(seed), 3, &mut 0);
        let replayed = replay(&registry(), &TreeSpec::new(parse(&text)), &record(&text, seed)).unwrap();
        assert_eq!(replayed.divergence, None, "{text}");
        assert!(replayed.n_ticks > 15);
    }
}

#[test]
fn the_same_inputs_give_the_same_journal() {
    for seed in 1..=100 {
        let text = support::random_tree(&mut support::numbers(seed), 3, &mut 0);
        assert_eq!(record(&text, seed), record(&text, seed), "{text}");
    }
}

#[track_caller]
fn check_divergence(old: &str, new: &str, expected: &str) {
    let mut tree = build(old);
    tree.set_journal_level(JournalLevel::Values);
    let names = tree.names();
    for tick in 0..4 {
        tree.tick(f64::from(tick), &mut Events::new());
    }
    let records: Vec<NamedRecord> = tree.drain_journal().into_iter().map(|record| names.of(record)).collect();
    let divergence = replay(&registry(), &TreeSpec::new(parse(new)), &records).unwrap().divergence.unwrap();
    assert_eq!(format!("tick {}: {} / {}", divergence.tick_idx, divergence.recorded, divergence.replayed), expected);
}

#[test]
fn a_replay_names_the_first_tick_that_a_changed_tree_decides_otherwise() {
    check_divergence(
        "timeout{secs:3}[a=RRRRRR]",
        "timeout{secs:2}[a=RRRRRR]",
        "tick 3: nothing more in this tick / timeout/a: running -> idle",
    );
    check_divergence(
        "retry{attempts:2}[a=RF]",
        "retry{attempts:3}[a=RF]",
        "tick 3: retry: running -> failure / retry/a: idle -> failure",
    );
    check_divergence(
        "sequence[a=S b=RS]",
        "sequence[a=S c=S b=RS]",
        "tick 1: sequence/b: idle -> running / sequence/c: idle -> failure",
    );
}

/// Scripts are run again with the values that leaves wrote.
#[test]
fn a_replay_runs_scripts_again() {
    let mut registry = Registry::<f64>::new();
    registry.step("measure", [PortSpec::output::<f64>("width_m")], |tick| {
        *tick.context += 1.0;
        let width_m = *tick.context;
        tick.set("width_m", width_m);
        Ok(())
    });
    let tree_of = |limit: &str| {
        TreeSpec::new(
            NodeSpec::new("fallback")
                .child(
                    NodeSpec::new("sequence")
                        .child(NodeSpec::new("measure"))
                        .child(NodeSpec::new("script_condition").with("code", format!("width_m > {limit}"))),
                )
                .child(NodeSpec::new("always_failure")),
        )
    };
    let mut tree = registry.build(&tree_of("2")).unwrap();
    tree.set_journal_level(JournalLevel::Values);
    let (names, mut context) = (tree.names(), 0.0);
    for tick in 0..5 {
        tree.tick(f64::from(tick), &mut context);
    }
    let records: Vec<NamedRecord> = tree.drain_journal().into_iter().map(|record| names.of(record)).collect();
    assert_eq!(replay(&registry, &tree_of("2"), &records).unwrap().divergence, None);
    let divergence = replay(&registry, &tree_of("3"), &records).unwrap().divergence.unwrap();
    assert_eq!(divergence.tick_idx, 3, "the third measurement is 3");
}

#[test]
fn a_saved_tree_goes_on_in_another_process_as_if_it_had_not_stopped() {
    for seed in 1..=300 {
        let text = support::random_tree(&mut support::numbers(seed), 3, &mut 0);
        let mut tree = build(&text);
        let mut next = support::numbers(seed + 7);
        let n_before = u32::try_from(next(10)).unwrap();
        for step_idx in 0..n_before {
            step(&mut tree, step_idx, &mut next);
        }
        let state = TreeState::from_literal(&tree.save().to_literal()).unwrap();
        assert_eq!(state, tree.save(), "{text}");
        let mut resumed = build(&text);
        resumed.resume(&state, &mut Events::new()).unwrap();
        // Leaves that are not running begin their scripts anew in the other process; those that run go on.
        for id in 0..u32::try_from(tree.n_nodes()).unwrap() {
            assert_eq!(tree.status(id), resumed.status(id), "{text}: {}", tree.path(id));
        }
        assert_eq!(resumed.save(), state, "{text}");
    }
}

#[test]
fn a_resumed_tree_polls_the_action_that_ran() {
    let text = "sequence[a=S retry{attempts:3}[b=F|RRS] c=S]";
    let mut tree = build(text);
    let mut events = Events::new();
    tree.tick(0.0, &mut events);
    tree.tick(1.0, &mut events);
    let state = tree.save();
    let mut resumed = build(text);
    let mut events = Events::new();
    resumed.resume(&state, &mut events).unwrap();
    assert_eq!(resumed.tick(2.0, &mut events), Status::Running);
    assert_eq!(resumed.tick(3.0, &mut events), Status::Success);
    assert_eq!(events, ["~b", ".b", ".b", "+c"]);
}

#[test]
fn what_cannot_be_resumed_is_said_before_anything_starts() {
    struct Mover;
    impl Action<()> for Mover {
        fn start(&mut self, _tick: &mut Tick<'_, ()>) -> Outcome {
            Ok(Progress::Running)
        }
        fn poll(&mut self, _tick: &mut Tick<'_, ()>) -> Outcome {
            Ok(Progress::Running)
        }
    }
    #[derive(Debug)]
    struct Cloud;
    let mut registry = Registry::<()>::new();
    registry.step("scan", [PortSpec::output::<Cloud>("cloud")], |tick| {
        tick.set("cloud", Cloud);
        Ok(())
    });
    registry.action("move", [], || Mover);
    registry.step("fit", [PortSpec::input::<Cloud>("cloud")], |_tick| Ok(()));
    let spec = TreeSpec::new(NodeSpec::new("sequence").children(["scan", "move", "fit"].map(NodeSpec::new)));
    let mut tree = registry.build(&spec).unwrap();
    tree.tick(0.0, &mut ());
    let mut resumed = registry.build(&spec).unwrap();
    let errors = resumed.resume(&tree.save(), &mut ()).unwrap_err();
    let texts: Vec<String> = errors.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "sequence/move was running and cannot be resumed: \"move\" saves nothing",
            "blackboard key \"cloud\" is lost: a value of type Cloud cannot be saved, and sequence/fit reads it",
        ]
    );
    assert_eq!(resumed.status(0), Status::Idle);
    let other = registry.build(&TreeSpec::new(NodeSpec::new("sequence").child(NodeSpec::new("scan")))).unwrap();
    assert!(matches!(other.check_resume(&tree.save())[0], ResumeError::Node { .. }));
}

#[test]
fn a_damaged_state_is_refused() {
    let text = "sequence[if_then_else[c?S a=RRS b=S]]";
    let mut tree = build(text);
    tree.tick(0.0, &mut Events::new());
    let mut state = tree.save();
    state.nodes.iter_mut().filter(|node| node.kind == "if_then_else").for_each(|node| node.memory[0] = 7);
    let errors = build(text).resume(&state, &mut Events::new()).unwrap_err();
    assert_eq!(errors, [ResumeError::Memory { path: "sequence/if_then_else".to_owned() }]);
}

#[test]
fn a_type_with_a_literal_form_is_saved() {
    #[derive(Debug, PartialEq)]
    struct Pose(f64);
    let mut registry = Registry::<()>::new();
    registry.literal_form::<Pose>(
        |pose| Some(Literal::Float(pose.0)),
        |literal| match literal {
            Literal::Float(x) => Ok(Pose(*x)),
            other => Err(format!("expected a number, found {other}")),
        },
    );
    registry.step("see", [PortSpec::output::<Pose>("pose")], |tick| {
        tick.set("pose", Pose(0.25));
        Ok(())
    });
    registry.step("use", [PortSpec::input::<Pose>("pose")], |_tick| Ok(()));
    let row = ["see", "use"].map(NodeSpec::new).into_iter().chain([NodeSpec::new("always_failure")]);
    let spec = TreeSpec::new(NodeSpec::new("sequence_with_memory").children(row));
    let mut tree = registry.build(&spec).unwrap();
    tree.tick(0.0, &mut ());
    let mut resumed = registry.build(&spec).unwrap();
    resumed.resume(&tree.save(), &mut ()).unwrap();
    assert_eq!(*resumed.entry::<Pose>("pose").unwrap(), Pose(0.25));
    assert_eq!(resumed.stamp("pose"), tree.stamp("pose"));
}

#[test]
fn a_reload_of_the_same_tree_changes_nothing() {
    for seed in 1..=200 {
        let text = support::random_tree(&mut support::numbers(seed), 3, &mut 0);
        let (mut tree, mut reloaded) = (build(&text), build(&text));
        let (mut next, mut same) = (support::numbers(seed + 3), support::numbers(seed + 3));
        for step_idx in 0..25 {
            assert_eq!(step(&mut tree, step_idx, &mut next), step(&mut reloaded, step_idx, &mut same), "{text} step {step_idx}");
            reloaded.reload(&registry(), &TreeSpec::new(parse(&text))).unwrap();
        }
    }
}

#[test]
fn a_reload_keeps_what_runs_and_refuses_to_lose_it() {
    let mut tree = build("sequence[a=S b=RRRR c=S]");
    let mut events = Events::new();
    tree.tick(0.0, &mut events);
    let vanish = tree.reload(&registry(), &TreeSpec::new(parse("sequence[a=S c=S]"))).unwrap_err();
    assert_eq!(vanish, EditError::RunningNodesVanish { paths: vec!["sequence/b".to_owned()] });
    assert!(matches!(tree.reload(&registry(), &TreeSpec::new(NodeSpec::new("nothing"))), Err(EditError::Build(_))));
    // A new child before the running one counts as done, one after it is still to come.
    let reloaded = tree.reload(&registry(), &TreeSpec::new(parse("sequence[a=S x=S b=RS d=S]"))).unwrap();
    assert_eq!(reloaded.added, ["sequence/x", "sequence/d"]);
    assert_eq!(reloaded.removed, ["sequence/c"]);
    assert_eq!(tree.tick(1.0, &mut events), Status::Success);
    assert_eq!(events, ["+a", "+b", ".b", "+d"]);
}

#[test]
fn a_tree_is_edited_by_path() {
    let mut spec = TreeSpec::new(parse("sequence[a=S retry{attempts:2}[b=S] retry{attempts:2}[c=S]]"));
    spec.insert("sequence/retry#2", 9, parse("x=S")).unwrap();
    assert_eq!(spec.root.children[2].children.len(), 2);
    spec.remove("sequence/retry#2/c").unwrap();
    spec.replace("sequence/retry/b", parse("y=F")).unwrap();
    assert_eq!(spec.remove("sequence/lift").unwrap_err(), EditError::UnknownPath { path: "sequence/lift".to_owned() });
    assert_eq!(spec.remove("sequence").unwrap_err(), EditError::Root);
    let mut tree = registry().build(&spec).unwrap();
    let mut events = Events::new();
    assert_eq!(tree.tick(0.0, &mut events), Status::Running);
    assert_eq!(events, ["+a", "+y"]);
}

#[test]
fn threads_end_a_wait_and_stop_when_halted() {
    let mut registry = Registry::<Vec<String>>::new();
    registry.threaded(
        "think",
        [PortSpec::setting::<u32>("ms"), PortSpec::output::<u32>("answer")],
        |tick| {
            let ms = tick.get::<u32>("ms")?;
            Ok(move |stop: &sfg_tree::Stop| {
                for _ in 0..ms {
                    if stop.is_set() {
                        return 0;
                    }
                    std::thread::sleep(Duration::from_millis(1));
                }
                ms + 1
            })
        },
        |tick, answer| {
            tick.set("answer", answer);
            Ok(Progress::Success)
        },
    );
    registry.step("say", [PortSpec::input::<u32>("answer")], |tick| {
        let answer = tick.get::<u32>("answer")?;
        tick.context.push(answer.to_string());
        Ok(())
    });
    registry.threaded(
        "fall",
        [],
        |_tick| Ok(|_stop: &sfg_tree::Stop| -> u32 { panic!("in the thread") }),
        |_tick, _result| Ok(Progress::Success),
    );
    let spec = TreeSpec::new(NodeSpec::new("sequence").child(NodeSpec::new("think").with("ms", 5)).child(NodeSpec::new("say")));
    let mut tree = registry.build(&spec).unwrap();
    let mut said = Vec::new();
    let begun = std::time::Instant::now();
    // Were the tree not woken, it would be ticked again after a minute.
    assert_eq!(tree.run(Duration::from_secs(60), &mut said), Status::Success);
    assert!(begun.elapsed() < Duration::from_secs(30));
    assert_eq!(said, ["6"]);

    let mut tree = registry.build(&TreeSpec::new(NodeSpec::new("think").with("ms", 100_000))).unwrap();
    assert_eq!(tree.tick(0.0, &mut said), Status::Running);
    tree.halt(&mut said);
    let begun = std::time::Instant::now();
    while !tree.poll_halt(0.0, &mut said) {
        assert!(begun.elapsed() < Duration::from_secs(30), "the thread does not stop");
    }

    let mut tree = registry.build(&TreeSpec::new(NodeSpec::new("fall"))).unwrap();
    assert_eq!(tree.run(Duration::from_millis(1), &mut said), Status::Failure);
    assert_eq!(tree.failure().unwrap().failure.reason, reason::PANICKED);
}

#[test]
fn parallel_branches_that_share_an_arm_are_seen_before_anything_moves() {
    let preview = build("parallel[sequence[arm.a=S both.b=S] sequence[hand.c=S d=S]]").preview();
    assert_eq!(preview.steps.len(), 4);
    let conflict = |first: &str, second: &str, part: &str| Conflict {
        parallel: "parallel".to_owned(),
        first: first.to_owned(),
        second: second.to_owned(),
        part: part.to_owned(),
    };
    assert_eq!(preview.conflicts, [conflict("parallel/sequence/b", "parallel/sequence/c", "hand")]);
    assert!(build("sequence[arm.a=S arm.b=S]").preview().conflicts.is_empty());
}

#[test]
fn mocked_leaves_give_preset_results() {
    let mut registry = Registry::<f64>::new();
    registry.step("measure", [PortSpec::output::<f64>("width_m")], |_tick| panic!("needs a sensor"));
    registry.threaded(
        "grasp",
        [],
        |_tick| Ok(|_stop: &sfg_tree::Stop| panic!("needs a hand")),
        |_tick, ()| Ok(Progress::Success),
    );
    let spec = TreeSpec::new(
        NodeSpec::new("sequence")
            .child(NodeSpec::new("measure"))
            .child(NodeSpec::new("script_condition").with("code", "width_m < 0.1"))
            .child(NodeSpec::new("retry").with("attempts", 3).child(NodeSpec::new("grasp").title("first"))),
    );
    let mocked = registry.mocked();
    let mut tree = mocked.build(&spec).unwrap();
    let failed = MockResult { status: Status::Failure, reason: "slipped".into(), takes_secs: 1.0, ..MockResult::default() };
    let measured = MockResult { writes: vec![("width_m".to_owned(), Literal::Float(0.08))], ..MockResult::default() };
    let results = [("measure", vec![measured]), ("first", vec![failed, MockResult { takes_secs: 0.5, ..MockResult::default() }])];
    let mut mocks = Mocks::new(&tree, results.map(|(name, results)| (name.to_owned(), results)).into());
    let mut now_secs = 0.0;
    while tree.tick(now_secs, &mut mocks) == Status::Running {
        now_secs += 0.25;
    }
    let calls: Vec<String> =
        mocks.calls().iter().map(|call| format!("{} {} {}", call.now_secs, call.title, call.status)).collect();
    assert_eq!(calls, ["0 measure success", "1 first failure", "1.5 first success"]);
}

#[test]
fn statistics_count_what_happened() {
    let mut tree = build("retry{attempts:3}[a=RF|RRS]");
    tree.set_journal_level(JournalLevel::Transitions);
    let mut statistics = Statistics::default();
    for tick in 0..4 {
        tree.tick(f64::from(tick), &mut Events::new());
        tree.drain_journal().iter().for_each(|record| statistics.observe(record));
    }
    let counts = statistics.of(1);
    assert_eq!((counts.n_started, counts.n_succeeded, counts.n_failed, counts.n_halted), (2, 1, 1, 0));
    assert!((counts.running_secs - 3.0).abs() < 1e-12);
}

/// A tree of built-in nodes only, ticked until it ends.
fn calculate(spec: &TreeSpec) -> (Status, Tree<()>) {
    let mut registry = Registry::<()>::new();
    registry.entry::<u32>("whole");
    registry.entry::<Vec<f64>>("list");
    registry.entry::<Queue<String>>("queue");
    registry.entry::<String>("mode");
    let mut tree = registry.build(spec).map_err(|errors| format!("{errors:?}")).unwrap();
    tree.set_entry("whole", 3_u32).unwrap();
    tree.set_entry("list", vec![0.5, 1.5]).unwrap();
    tree.set_entry("queue", ["a", "b", "c"].map(str::to_owned).into_iter().collect::<Queue<String>>()).unwrap();
    tree.set_entry("mode", "slow".to_owned()).unwrap();
    let mut status = Status::Running;
    for tick in 0..50 {
        status = tree.tick(f64::from(tick), &mut ());
        if status != Status::Running {
            break;
        }
    }
    (status, tree)
}

#[track_caller]
fn check_script(code: &str, key: &str, expected: Result<Literal, &str>) {
    let spec = TreeSpec::new(NodeSpec::new("script").with("code", code));
    let (_, tree) = calculate(&spec);
    let found = match tree.failure() {
        Some(at) => Err(at.failure.to_string()),
        None => Ok(tree.literal(key).unwrap()),
    };
    assert_eq!(found, expected.map_err(str::to_owned), "{code}");
}

#[test]
fn scripts_read_and_write_entries_of_their_types() {
    check_script("x := whole * 2", "x", Ok(Literal::Int(6)));
    check_script("whole := whole + 1", "whole", Ok(Literal::Int(4)));
    check_script("whole := 1.5", "whole", Err("script_failed: expected a whole number, found 1.5"));
    check_script("mode := mode + 'er'", "mode", Ok("slower".into()));
    check_script("mode := 3", "mode", Err("script_failed: expected a text, found 3"));
    check_script("y := mode == 'slow' ? 0.5 : 1", "y", Ok(Literal::Float(0.5)));
    check_script("z := list", "z", Err("script_failed: blackboard key \"list\" holds no number, text or truth"));
}

#[test]
fn loops_go_over_lists_and_queues() {
    let sum = |over: &str| {
        NodeSpec::new("loop")
            .with_key("over", over)
            .with_key("item", "item")
            .child(NodeSpec::new("script").with("code", "sum := sum + item"))
    };
    let (status, tree) = calculate(&TreeSpec::new(sum("list")).entry("sum", 0));
    assert_eq!((status, tree.literal("sum")), (Status::Success, Some(Literal::Int(2))));
    let (status, tree) = calculate(&TreeSpec::new(sum("queue")).entry("sum", ""));
    assert_eq!((status, tree.literal("sum")), (Status::Success, Some("abc".into())));
    assert!(tree.entry::<Queue<String>>("queue").unwrap().is_empty());
    let given = NodeSpec::new("loop")
        .with("over", vec![4, 5])
        .with("if_empty", "failure")
        .child(NodeSpec::new("script").with("code", "sum := sum + item"));
    let (status, tree) = calculate(&TreeSpec::new(given).entry("sum", 0));
    assert_eq!((status, tree.literal("sum")), (Status::Failure, Some(Literal::Int(9))));
    assert_eq!(tree.failure().unwrap().failure.reason, reason::NOTHING_LEFT);
}

#[test]
fn a_switch_compares_texts_and_numbers() {
    let set = |value: i64| NodeSpec::new("script").with("code", format!("chosen := {value}"));
    let switch = |key: &str, cases: Vec<&str>| {
        let n = i64::try_from(cases.len()).unwrap();
        TreeSpec::new(NodeSpec::new("switch").with_key("variable", key).with("cases", cases).children((1..=n + 1).map(set)))
    };
    assert_eq!(calculate(&switch("mode", vec!["fast", "slow"])).1.literal("chosen"), Some(Literal::Int(2)));
    assert_eq!(calculate(&switch("whole", vec!["3", "4"])).1.literal("chosen"), Some(Literal::Int(1)));
    assert_eq!(calculate(&switch("whole", vec!["5"])).1.literal("chosen"), Some(Literal::Int(2)));
}

#[test]
fn entries_tell_when_they_were_written() {
    let watch = NodeSpec::new("sequence")
        .child(NodeSpec::new("script").with("code", "n := n + 1; m := n < 3 ? n : m"))
        .child(
            NodeSpec::new("skip_unless_updated")
                .with_key("entry", "flag")
                .child(NodeSpec::new("script").with("code", "seen := seen + 1")),
        )
        .child(
            NodeSpec::new("force_success").child(
                NodeSpec::new("precondition")
                    .with("if", "n == 2 || n == 4")
                    .child(NodeSpec::new("set_blackboard").with("value", 1).with_key("output_key", "flag")),
            ),
        )
        .child(NodeSpec::new("script_condition").with("code", "n == 6"));
    let spec = TreeSpec::new(NodeSpec::new("retry").with("attempts", -1).child(watch))
        .entry("n", 0)
        .entry("m", 0)
        .entry("seen", 0)
        .entry("flag", 0);
    let (status, tree) = calculate(&spec);
    assert_eq!((status, tree.literal("seen")), (Status::Success, Some(Literal::Int(2))));
}

#[test]
fn conditions_surround_a_node() {
    let spec = TreeSpec::new(
        NodeSpec::new("sequence")
            .child(NodeSpec::new("always_failure").when(When::SkipIf, "n == 0"))
            .child(
                NodeSpec::new("always_failure")
                    .when(When::SuccessIf, "true")
                    .when(When::OnSuccess, "n += 1")
                    .when(When::Post, "n += 10"),
            )
            .child(
                NodeSpec::new("force_success")
                    .child(NodeSpec::new("always_success").when(When::FailureIf, "n > 5").when(When::OnFailure, "n += 100")),
            ),
    )
    .entry("n", 0);
    let (status, tree) = calculate(&spec);
    assert_eq!((status, tree.literal("n")), (Status::Success, Some(Literal::Int(111))));
    let broken = TreeSpec::new(NodeSpec::new("always_success").when(When::SkipIf, "mode > 1"));
    assert_eq!(calculate(&broken).1.failure().unwrap().failure.reason, reason::SCRIPT_FAILED);
}

#[test]
fn a_condition_that_ceases_to_hold_halts_the_node() {
    let mut registry = registry();
    registry.entry::<bool>("go");
    let node = parse("sequence[a=RRR]").when(When::While, "go").when(When::OnHalted, "was_halted := true");
    let mut tree = registry.build(&TreeSpec::new(node)).unwrap();
    let mut events = Events::new();
    tree.set_entry("go", true).unwrap();
    assert_eq!(tree.tick(0.0, &mut events), Status::Running);
    tree.set_entry("go", false).unwrap();
    assert_eq!(tree.tick(1.0, &mut events), Status::Skipped);
    assert_eq!(events, ["+a", "-a"]);
    assert_eq!(tree.literal("was_halted"), Some(Literal::Bool(true)));
}

#[test]
fn a_blackboard_is_restored() {
    let spec = TreeSpec::new(NodeSpec::new("script").with("code", "n += 1")).entry("n", 0);
    let mut tree = Registry::<()>::new().build(&spec).unwrap();
    tree.tick(0.0, &mut ());
    let backup = tree.backup();
    tree.tick(1.0, &mut ());
    assert_eq!(tree.literal("n"), Some(Literal::Int(2)));
    tree.restore(&backup);
    assert_eq!(tree.literal("n"), Some(Literal::Int(1)));
}

#[test]
fn a_halt_that_panics_ends_it() {
    struct Broken;
    impl Action<()> for Broken {
        fn start(&mut self, _tick: &mut Tick<'_, ()>) -> Outcome {
            Ok(Progress::Running)
        }
        fn halt(&mut self, _tick: &mut Tick<'_, ()>) -> Halt {
            panic!("broken")
        }
    }
    let mut registry = Registry::<()>::new();
    registry.action("broken", [], || Broken);
    let mut tree = registry.build(&TreeSpec::new(NodeSpec::new("broken"))).unwrap();
    tree.tick(0.0, &mut ());
    tree.halt(&mut ());
    assert!(tree.poll_halt(1.0, &mut ()));
    let reasons: Vec<&Failure> = tree.failures().map(|at| &at.failure).collect();
    assert_eq!(reasons, [&Failure::new(reason::PANICKED, "while halting: broken")]);
}
