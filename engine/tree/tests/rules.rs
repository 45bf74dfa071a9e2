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
fn retry_tries_again_in_the_next_tick_after_a_child_done_in_one_call() {
    check("retry{attempts:3}[a=F|RF|S]", "ttt", "+a R ; +a R ; .a +a S");
    check("retry{attempts:-1}[a=F]", "ttt", "+a R ; +a R ; +a R");
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
fn a_halt_that_takes_several_ticks_holds_back_what_shares_its_footprint() {
    // The arm is asked to stop three times; what moves it starts after that, what moves the hand at once.
    check("reactive_fallback[sequence[c?FSSSSS arm.a=RR] arm.b=RRR!2]", "ttttt", "?c +b R ; ?c -b R ; -b R ; -b +a R ; .a R");
    check("reactive_fallback[sequence[c?FSSSSS hand.a=RR] arm.b=RRR!2]", "ttt", "?c +b R ; ?c +a -b R ; -b .a R");
}

#[test]
fn a_halt_that_takes_longer_than_it_said_fails_what_needs_the_footprint() {
    check_failure("reactive_fallback[sequence[c?FSSSSSSSS arm.a=RR] arm.b=RRRRRRRR!9]", 5, "reactive_fallback/b halt_overdue");
}

#[test]
fn an_action_that_waits_for_another_is_not_halted_as_if_it_ran() {
    check("reactive_fallback[reactive_sequence[c?FSF arm.a=RR] arm.b=RRR!1]", "ttt", "?c +b R ; ?c -b R ; -b ?c +b R");
}

#[test]
fn parallel_branches_share_no_declared_footprint() {
    check("parallel[arm.a=RS arm.b=RS]", "tttt", "+a R ; .a +b R ; .b S ; +a R");
    check("parallel[arm.a=RS hand.b=RS both.c=S]", "ttt", "+a +b R ; .a .b +c S ; +a +b R");
    check("parallel[a=RS b=RS]", "tt", "+a +b R ; .a .b S");
}

#[test]
fn reactive_nodes_start_at_once_what_occupies_nothing() {
    check("reactive_sequence[free.a=S|R b=R]", "tt", "+a +b R ; +a -b R");
}

#[test]
fn async_nodes_yield_after_a_child_done_in_one_call() {
    check("async_sequence[a=S b=RS c=S]", "ttt", "+a R ; +b R ; .b +c S");
    check("async_fallback[a=F b=RF c=S]", "ttt", "+a R ; +b R ; .b +c S");
    check("async_sequence[a=K b=S]", "t", "+a +b S");
}

#[test]
fn sequence_with_memory_goes_on_at_the_child_it_failed_at() {
    check("sequence_with_memory[a=RS b=RF|S c=S]", "ttttt", "+a R ; .a +b R ; .b F ; +b R ; +c S");
    check("sequence_with_memory[a=RS b=R]", "tthtt", "+a R ; .a +b R ; -b h ; +b R ; .b R");
}

#[test]
fn parallel_all_waits_for_every_child() {
    check("parallel_all[a=F b=RS]", "tt", "+a +b R ; .b F");
    check("parallel_all{max_failures:2}[a=F b=RS]", "tt", "+a +b R ; .b S");
    check("parallel_all{max_failures:-1}[a=F b=RF]", "tt", "+a +b R ; .b F");
    check("parallel_all[a=K b=K]", "t", "+a +b K");
    check_failure("parallel_all[a=F/slipped b=RS]", 2, "parallel_all/a slipped");
}

#[test]
fn if_then_else_asks_once() {
    check("if_then_else[c?SF a=RS b=S]", "tt", "?c +a R ; .a S");
    check("if_then_else[c?FS a=RS b=RF]", "tt", "?c +b R ; .b F");
    check("if_then_else[c?F a=S]", "t", "?c F");
    check("if_then_else[c=RS a=R b=S]", "tth", "+c R ; .c +a R ; -a h");
    check("if_then_else[c=K a=S]", "t", "+c K");
}

#[test]
fn while_do_else_asks_on_every_tick() {
    check("while_do_else[c?SSF a=RRR b=RS]", "tttt", "?c +a R ; ?c .a R ; ?c -a +b R ; ?c .b S");
    check("while_do_else[c?SF a=RRR]", "tt", "?c +a R ; ?c -a F");
    check("while_do_else[c=S a=R]", "tt", "+c +a R ; +c .a R");
}

#[test]
fn try_catch_cleans_up_after_a_failure() {
    check("try_catch[a=S b=F c=RS]", "tt", "+a +b +c R ; .c F");
    check("try_catch[a=S b=RS c=S]", "tt", "+a +b R ; .b S");
    check("try_catch[a=R c=S]", "th", "+a R ; -a h");
    check("try_catch{catch_on_halt:true}[a=R c=S]", "th", "+a R ; -a +c h");
    check("try_catch{catch_on_halt:true}[a=R c=R]", "th", "+a R ; -a +c -c h");
    check("try_catch{catch_on_halt:true}[a=F c=R]", "th", "+a +c R ; -c h");
    check_failure("try_catch[a=F/slipped c=F/other]", 1, "try_catch/a slipped");
}

#[test]
fn recover_does_what_the_reason_asks_for() {
    check("recover{attempts:3,on:slipped+no_path}[a=F/slipped b=S c=S]", "tttt", "+a +b R ; +a +b R ; +a F ; +a +b R");
    check("recover{attempts:3,on:slipped+no_path}[a=F/no_path b=S c=RS]", "tt", "+a +c R ; .c +a +c R");
    check("recover{attempts:3,on:slipped}[a=F/other b=S]", "t", "+a F");
    check("recover{attempts:3,on:any}[a=F/other b=S]", "t", "+a +b R");
    check_failure("recover{attempts:3,on:any}[a=F/other b=F/worse]", 1, "recover/a other");
}

#[test]
fn keep_running_until_failure_never_succeeds() {
    check("keep_running_until_failure[a=S|K|F]", "ttt", "+a R ; +a R ; +a F");
}

#[test]
fn delay_waits_before_its_child() {
    check("delay{secs:2}[a=RS]", "tttt", "R ; R ; +a R ; .a S");
    check("delay{secs:2}[a=S]", "thttt", "R ; h ; R ; R ; +a S");
}

#[test]
fn rate_limit_begins_its_child_at_most_so_often() {
    check("rate_limit{hz:0.5}[a=S]", "ttttt", "+a S ; R ; +a S ; R ; +a S");
    check("rate_limit{hz:0.5}[a=RRRS]", "tttt", "+a R ; .a R ; .a R ; .a S");
}

#[test]
fn run_once_is_done_once() {
    check("run_once[a=RS]", "tttht", "+a R ; .a S ; K ; h ; K");
    check("run_once{then_skip:false}[a=F/slipped]", "tt", "+a F ; F");
    check_failure("run_once{then_skip:false}[a=F/slipped]", 2, "run_once slipped");
    check("run_once[a=R|S]", "thtt", "+a R ; -a h ; +a S ; K");
}

#[test]
fn sleep_and_constant_leaves() {
    check("sleep{secs:2}", "tttt", "R ; R ; S ; R");
    check("sequence[always_success always_failure]", "t", "F");
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
        let mut next = support::numbers(seed);
        let mut n_leaves = 0;
        let text = support::random_tree(&mut next, 3, &mut n_leaves);
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
                    let is_right = match event.as_bytes()[0] {
                        b'-' => running.remove(&event[1..]),
                        // Cleaning up begins, and ends with the halt.
                        _ => running.insert(event[1..].to_owned()),
                    };
                    assert!(is_right, "{text}: {event}");
                }
                running.retain(|name| !events.contains(&format!("+{name}")));
                assert!(running.is_empty(), "{text}: {running:?} were not halted");
                continue;
            }
            let status = tree.tick(f64::from(tick), &mut events);
            for (event_idx, event) in events.iter().enumerate() {
                // An earlier call of this tick may have been the last one of an activation.
                let was_called = events[..event_idx].iter().any(|earlier| earlier[1..] == event[1..]);
                if event.starts_with('+') && was_called {
                    running.remove(&event[1..]);
                }
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
