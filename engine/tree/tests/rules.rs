//! The rules of every control and decorator, as traces.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod support;

use sfg_tree::{Status, reason};

#[track_caller]
fn check(tree: &str, steps: &str, expected: &str) {
    assert_eq!(support::run(tree, steps), expected, "{tree}");
}

/// The failing node and its reason after the last tick.
#[track_caller]
fn check_failure(tree: &str, n_ticks: u32, expected: &str) {
    let (mut tree, mut events) = (support::build(tree), Vec::new());
    let mut status = Status::Idle;
    for tick in 0..n_ticks {
        status = tree.tick(f64::from(tick), &mut events);
    }
    assert_eq!(status, Status::Failure);
    let at = tree.failure().unwrap();
    assert_eq!(format!("{} {}", tree.path(at.node), at.failure.reason), expected);
}

#[test]
fn sequence_goes_on_where_it_stopped() {
    check("sequence[a=S b=RRS c=S]", "ttt", "+a +b R ; .b R ; .b +c S");
}

#[test]
fn sequence_ends_at_the_first_failure() {
    check("sequence[a=S b=F c=S]", "t", "+a +b F");
    check_failure("sequence[a=S b=F/slipped c=S]", 1, "sequence/b slipped");
}

#[test]
fn sequence_halts_its_running_child() {
    check("sequence[a=S b=R c=S]", "thht", "+a +b R ; -b h ; h ; +a +b R");
}

#[test]
fn sequence_passes_over_skipped_children() {
    check("sequence[a=K b=S]", "t", "+a +b S");
    check("sequence[a=K b=K]", "t", "+a +b K");
}

#[test]
fn sequence_starts_anew_after_its_end() {
    check("sequence[a=S b=S|F]", "tt", "+a +b S ; +a +b F");
}

#[test]
fn fallback_goes_on_where_it_stopped() {
    check("fallback[a=F b=RRF c=S]", "ttt", "+a +b R ; .b R ; .b +c S");
}

#[test]
fn fallback_fails_as_its_last_child() {
    check("fallback[a=F b=F]", "t", "+a +b F");
    check_failure("fallback[a=F/no_view b=F/no_path]", 1, "fallback/b no_path");
}

#[test]
fn fallback_halts_its_running_child() {
    check("fallback[a=F b=R]", "tht", "+a +b R ; -b h ; +a +b R");
}

#[test]
fn fallback_passes_over_skipped_children() {
    check("fallback[a=K b=F]", "t", "+a +b F");
    check("fallback[a=K b=K]", "t", "+a +b K");
}

#[test]
fn reactive_sequence_asks_its_conditions_on_every_tick() {
    check("reactive_sequence[c?SSF a=RRRR]", "ttt", "?c +a R ; ?c .a R ; ?c -a F");
}

// BehaviorTree.CPP issue 1031: there the new child starts before the old one is halted.
#[test]
fn reactive_sequence_halts_the_running_child_before_an_action_above_it_starts() {
    check("reactive_sequence[a=S|R b=R]", "ttt", "+a +b R ; -b +a R ; .a R");
}

#[test]
fn reactive_fallback_halts_the_running_child_before_an_action_above_it_starts() {
    check(
        "reactive_fallback[sequence[low?FFS charge=RR] work=RRRR]",
        "tttt",
        "?low +work R ; ?low .work R ; ?low -work +charge R ; .charge R",
    );
}

#[test]
fn reactive_nodes_halt_an_old_child_deep_inside() {
    check("reactive_fallback[sequence[c?FS a=R] retry{attempts:2}[sequence[x=S y=R]]]", "tt", "?c +x +y R ; ?c -y +a R");
}

#[test]
fn a_decorator_that_runs_between_rounds_takes_the_place_of_the_running_child() {
    check("reactive_sequence[retry{attempts:2}[c?SFS] a=RR]", "ttt", "?c +a R ; ?c -a R ; ?c +a R");
}

#[test]
fn reactive_fallback_ends_at_the_first_success() {
    check("reactive_fallback[c?FS a=R]", "tt", "?c +a R ; ?c -a S");
    check("reactive_fallback[a=F b=F]", "t", "+a +b F");
}

#[test]
fn reactive_nodes_halt_midway() {
    check("reactive_sequence[c?S a=R]", "thht", "?c +a R ; -a h ; h ; ?c +a R");
}

#[test]
fn parallel_waits_for_all_by_default() {
    check("parallel[a=RS b=RRS]", "ttt", "+a +b R ; .a .b R ; .b S");
}

#[test]
fn parallel_ends_at_its_threshold_and_halts_the_rest() {
    check("parallel{success:1}[a=RR b=RS c=R]", "tt", "+a +b +c R ; .a .b -a -c S");
    check("parallel[a=R b=F]", "t", "+a +b -a F");
    check("parallel{success:1,failure:2}[a=F b=RF c=R]", "tt", "+a +b +c R ; .b -c F");
}

#[test]
fn parallel_fails_when_success_is_out_of_reach() {
    check("parallel{success:2,failure:3}[a=R b=F c=RF]", "tt", "+a +b +c R ; .a .c -a F");
    check_failure("parallel{failure:2}[a=R b=F/slipped]", 1, "parallel/b slipped");
    check_failure("parallel{success:3}[a=R b=R]", 1, "parallel out_of_reach");
}

#[test]
fn parallel_reports_its_own_failure_and_not_a_later_recovered_one() {
    check_failure("parallel{failure:2}[a=F/slipped fallback[c=RF d=S] e=RRF/no_path]", 1, "parallel/a slipped");
    check_failure("parallel{success:1,failure:2}[a=F/slipped fallback[c=RF d=R] e=RRF/no_path]", 3, "parallel/e no_path");
    check_failure("sequence[parallel{success:1,failure:2}[a=F/first b=RF/second] c=S]", 2, "sequence/parallel/b second");
}

#[test]
fn parallel_halts_midway() {
    check("parallel[a=RS b=RRR]", "tthth", "+a +b R ; .a .b R ; -b h ; +a +b R ; -a -b h");
}

#[test]
fn retry_tries_again_in_the_next_tick() {
    check("retry{attempts:3}[a=F|RF|S]", "tttt", "+a R ; +a R ; .a R ; +a S");
}

#[test]
fn retry_gives_up_after_its_attempts() {
    check("retry{attempts:2}[a=F]", "ttt", "+a R ; +a F ; +a R");
    check_failure("retry{attempts:2}[a=F/slipped]", 2, "retry/a slipped");
}

#[test]
fn retry_leaves_other_reasons_alone() {
    check("retry{attempts:3,on:slipped+no_path}[a=F/slipped]", "ttt", "+a R ; +a R ; +a F");
    check("retry{attempts:3,on:no_path}[a=F/slipped]", "t", "+a F");
}

#[test]
fn retry_forgets_its_attempts_when_halted() {
    check("retry{attempts:2}[a=F|R|F|F]", "tthtt", "+a R ; +a R ; -a h ; +a R ; +a F");
}

#[test]
fn repeat_counts_rounds() {
    check("repeat{times:2}[a=S|RS]", "ttt", "+a R ; +a R ; .a S");
    check("repeat{times:3}[a=S|F]", "tt", "+a R ; +a F");
    check("repeat[a=S]", "ttth", "+a R ; +a R ; +a R ; h");
}

#[test]
fn timeout_halts_its_child() {
    check("timeout{secs:2}[a=RRRR]", "tttt", "+a R ; .a R ; -a F ; +a R");
    check_failure("timeout{secs:2}[a=RRRR]", 3, "timeout timeout");
    check("timeout{secs:2}[a=RS]", "tt", "+a R ; .a S");
    check("timeout{secs:2}[a=R]", "thtt", "+a R ; -a h ; +a R ; .a R");
}

#[test]
fn inverter_turns_the_result() {
    check("inverter[a=RS]", "tt", "+a R ; .a F");
    check("inverter[a=RF]", "tt", "+a R ; .a S");
    check("inverter[a=K]", "t", "+a K");
    check_failure("inverter[a=S]", 1, "inverter inverted");
}

#[test]
fn force_nodes_keep_running_and_skipped() {
    check("force_success[a=RF]", "tt", "+a R ; .a S");
    check("force_failure[a=RS]", "tt", "+a R ; .a F");
    check("force_success[a=K]", "t", "+a K");
    check("force_success[a=R]", "th", "+a R ; -a h");
}

#[test]
fn a_panic_is_a_failure_and_stops_the_action() {
    check("fallback[a=RX b=S]", "tt", "+a R ; .a -a +b S");
    check_failure("sequence[a=X]", 1, "sequence/a panicked");
}

#[test]
fn a_recovered_failure_is_kept_in_the_history() {
    let mut tree = support::build("fallback[a=F/no_view b=S]");
    assert_eq!(tree.tick(0.0, &mut Vec::new()), Status::Success);
    let history: Vec<&str> = tree.failures().map(|at| at.failure.reason.as_ref()).collect();
    assert_eq!(history, ["no_view"]);
    assert!(!reason::ALL.contains(&"no_view"));
}

/// Trees from a seeded generator, ticked and halted at random.
#[test]
fn a_halted_tree_is_idle_and_every_started_action_ends_once() {
    for seed in 1..=300u64 {
        let mut random = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut next = |bound: u64| {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            random % bound
        };
        let mut n_leaves = 0;
        let text = random_tree(&mut next, 3, &mut n_leaves);
        let mut tree = support::build(&text);
        let mut running = std::collections::BTreeSet::new();
        for tick in 0..40u32 {
            let mut events = Vec::new();
            if next(6) == 0 {
                tree.halt(&mut events);
                for id in 0..u32::try_from(tree.n_nodes()).unwrap() {
                    assert_eq!(tree.status(id), Status::Idle, "{text}");
                }
                for event in &events {
                    assert!(event.starts_with('-') && running.remove(&event[1..]), "{text}: {event} on a node that does not run");
                }
                assert!(running.is_empty(), "{text}: {running:?} were not halted");
                continue;
            }
            let status = tree.tick(f64::from(tick), &mut events);
            for event in &events {
                match event.as_bytes()[0] {
                    b'-' => assert!(running.remove(&event[1..]), "{text}: {event} on a node that does not run"),
                    b'+' => assert!(running.insert(event[1..].to_owned()), "{text}: {event} on a running node"),
                    _ => assert!(running.contains(&event[1..]), "{text}: {event} on a node that does not run"),
                }
            }
            // What the tree says about its leaves after the tick.
            running = tree
                .definition()
                .filter(|node| node.kind == "scripted" && tree.status(node.id) == Status::Running)
                .map(|node| node.title)
                .collect();
            assert!(status == Status::Running || running.is_empty(), "{text}: {running:?} outlive the tree");
        }
    }
}

fn random_tree(next: &mut impl FnMut(u64) -> u64, depth: u32, n_leaves: &mut u32) -> String {
    if depth == 0 || next(5) == 0 {
        *n_leaves += 1;
        let script: String = (0..=next(4)).map(|_| ['R', 'R', 'S', 'F', 'K', '|'][usize::try_from(next(6)).unwrap()]).collect();
        return format!("n{n_leaves}={}R", script.replace('|', "R|"));
    }
    let kinds = [
        "sequence",
        "fallback",
        "reactive_sequence",
        "reactive_fallback",
        "parallel",
        "parallel{success:1}",
        "retry{attempts:2}",
        "repeat{times:2}",
        "timeout{secs:3}",
        "inverter",
        "force_success",
    ];
    let kind_idx = usize::try_from(next(11)).unwrap();
    let n_children = if kind_idx < 6 { 1 + next(3) } else { 1 };
    let children: Vec<String> = (0..n_children).map(|_| random_tree(next, depth - 1, n_leaves)).collect();
    format!("{}[{}]", kinds[kind_idx], children.join(" "))
}
