//! Reference traces of every control and decorator over every pattern of results, in `tests/traces`, one file a family.
//!
//! A line is `tree | steps | trace`. The trees come from [`families`]; `SFG_WRITE_TRACES=1` writes the files anew, and what
//! changed is read as a diff. A second program, `support/model.rs`, says the same from the tables alone.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

#[path = "support/model.rs"]
mod model;
mod support;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Results of a child: at once, after a tick, and differently on its second activation.
const SHORT: [&str; 5] = ["S", "F", "K", "RS", "RF"];
const LONG: [&str; 11] = ["S", "F", "K", "RS", "RF", "RK", "RRS", "F|S", "RF|S", "S|F", "RS|K"];

/// Steps for a tree: ticks, and where something runs also a halt midway.
fn push(cases: &mut Vec<(String, String)>, tree: String) {
    let runs =
        tree.contains('R') || ["retry", "repeat", "keep", "delay", "sleep", "async"].iter().any(|kind| tree.starts_with(kind));
    cases.push((tree.clone(), "tttt".to_owned()));
    if runs {
        cases.push((tree, "thtt".to_owned()));
    }
}

/// Every pair of short results below `kind`, and rows of three.
fn rows(cases: &mut Vec<(String, String)>, kind: &str) {
    for a in SHORT {
        for b in SHORT {
            push(cases, format!("{kind}[a={a} b={b}]"));
        }
    }
    for three in ["a=S b=RS c=F", "a=F b=RF c=S", "a=K b=RK c=K", "a=RS b=K c=RF", "a=RF b=S|F c=RRS"] {
        push(cases, format!("{kind}[{three}]"));
        cases.push((format!("{kind}[{three}]"), "tththttt".to_owned()));
    }
}

fn decorated(cases: &mut Vec<(String, String)>, kinds: &[&str]) {
    for kind in kinds {
        for script in LONG {
            push(cases, format!("{kind}[a={script}]"));
        }
    }
}

fn families() -> Vec<(&'static str, Vec<(String, String)>)> {
    let of_rows = |kinds: &[&str]| {
        let mut cases = Vec::new();
        kinds.iter().for_each(|kind| rows(&mut cases, kind));
        cases
    };
    let of_decorators = |kinds: &[&str]| {
        let mut cases = Vec::new();
        decorated(&mut cases, kinds);
        cases
    };
    let listed = |lines: &[(&str, &str)]| lines.iter().map(|(tree, steps)| ((*tree).to_owned(), (*steps).to_owned())).collect();
    let mut reactive = of_rows(&["reactive_sequence", "reactive_fallback"]);
    for (c, a) in [("SSFF", "RRRR"), ("SFSF", "RS"), ("FSFS", "RF"), ("FFSS", "RRK")] {
        for kind in ["reactive_sequence", "reactive_fallback"] {
            push(&mut reactive, format!("{kind}[c?{c} a={a}]"));
            push(&mut reactive, format!("{kind}[a={a} c?{c} b=R]"));
        }
    }
    let mut choice = Vec::new();
    for kind in ["if_then_else", "while_do_else"] {
        for c in ["c=S", "c=F", "c=K", "c=RS", "c=RF", "c=S|F", "c=F|S", "c?SSFF", "c?FSFS"] {
            push(&mut choice, format!("{kind}[{c} a=RRS]"));
            push(&mut choice, format!("{kind}[{c} a=RRS b=RF]"));
            push(&mut choice, format!("{kind}[{c} a=K b=S]"));
        }
    }
    let mut rescue = Vec::new();
    for kind in ["try_catch", "try_catch{catch_on_halt:true}", "recover{attempts:3,on:any}", "recover{attempts:2,on:broken}"] {
        for a in ["S", "F", "K", "RS", "RF", "F|S", "RF|RS"] {
            for b in ["S", "F", "K", "RS"] {
                push(&mut rescue, format!("{kind}[a={a} b={b}]"));
            }
        }
    }
    for (a, b, c) in [("F/slipped", "S", "F"), ("F/lost", "F", "RS"), ("RF/other", "S", "S"), ("F/lost", "S", "RK")] {
        push(&mut rescue, format!("recover{{attempts:3,on:slipped+lost}}[a={a} b={b} c={c}]"));
        push(&mut rescue, format!("try_catch[a=S b={a} c={c}]"));
    }
    let mut rounds = of_decorators(&["retry{attempts:1}", "retry{attempts:3}", "retry{attempts:-1}", "repeat{times:1}"]);
    decorated(&mut rounds, &["repeat{times:3}", "repeat", "keep_running_until_failure"]);
    for script in ["F/slipped", "F/lost", "RF/slipped", "RF/lost"] {
        push(&mut rounds, format!("retry{{attempts:3,on:slipped}}[a={script}]"));
    }
    let nested = (1..=60).map(|seed| (support::random_tree(&mut support::numbers(seed), 2, &mut 0), "ttthtttt".to_owned()));
    vec![
        ("sequence", of_rows(&["sequence", "async_sequence", "sequence_with_memory"])),
        ("fallback", of_rows(&["fallback", "async_fallback"])),
        ("reactive", reactive),
        (
            "parallel",
            of_rows(&["parallel", "parallel{success:1}", "parallel{failure:2}", "parallel_all", "parallel_all{max_failures:2}"]),
        ),
        ("choice", choice),
        ("rescue", rescue),
        ("mapped", of_decorators(&["inverter", "force_success", "force_failure"])),
        ("rounds", rounds),
        ("time", of_decorators(&["timeout{secs:1}", "timeout{secs:2}", "delay{secs:1}", "rate_limit{hz:0.5}"])),
        ("once", of_decorators(&["run_once", "run_once{then_skip:false}"])),
        ("entries", listed(ENTRIES)),
        ("footprint", listed(FOOTPRINT)),
        ("nested", nested.collect()),
    ]
}

/// Nodes that look at the blackboard; the entry `n` begins with 0.
const ENTRIES: &[(&str, &str)] = &[
    ("sequence[script{code:n := n + 1} script_condition{code:n < 3} a=S]", "tttt"),
    ("switch{variable:$n,cases:0+1}[a=RRS b=RRS c=RRS]", "tttht"),
    ("sequence[script{code:n := n + 1} switch{variable:$n,cases:1+2}[a=S b=S c=S]]", "tttt"),
    ("reactive_sequence[script{code:n := n + 1} switch{variable:$n,cases:1+3}[a=RRS b=RRS c=RRS]]", "tttttt"),
    ("precondition{if:n < 1}[a=RS]", "ttt"),
    ("precondition{if:n > 1}[a=RS]", "tt"),
    ("precondition{if:n > 1,else:skipped}[a=RS]", "tt"),
    ("precondition{if:n > 1,else:success}[a=RS]", "tt"),
    ("sequence[script{code:n := n + 1} force_success[precondition{if:n == 2}[a=RRS]]]", "ttthtt"),
    ("reactive_sequence[script{code:n := n + 1} precondition{if:n == 1}[a=RRRS]]", "ttttt"),
    ("loop{over:1+2+3,item:$i}[a=S]", "ttttt"),
    ("loop{over:1+2,item:$i}[a=RS]", "tttttt"),
    ("loop{over:1+2+3,item:$i}[a=S|F]", "tttt"),
    ("loop{over:1+2+3,item:$i}[a=K]", "ttttt"),
    ("loop{over:1+2,item:$i}[a=RS]", "thttttt"),
    ("loop{over:1+2,item:$i,if_empty:failure}[a=S]", "ttt"),
    ("loop{over:1,item:$i,if_empty:skipped}[a=S]", "ttt"),
    ("skip_unless_updated{entry:$n}[a=S]", "tt"),
    ("sequence[script{code:n := 1} skip_unless_updated{entry:$n}[a=RS]]", "tttt"),
    ("sequence[skip_unless_updated{entry:$n}[a=S] script{code:n := 1}]", "ttt"),
    ("reactive_sequence[run_once[script{code:n := 1}] skip_unless_updated{entry:$n}[a=RS] b=R]", "tttt"),
    ("parallel[wait_value_update{entry:$n}[a=S] delay{secs:1}[script{code:n := 1}]]", "tttt"),
    ("parallel[wait_value_update{entry:$n}[a=RS] b=RS script{code:n := 1}]", "thttt"),
    ("fallback[was_entry_updated{entry:$n} a=S]", "tt"),
    ("sequence[script{code:n := 1} was_entry_updated{entry:$n} a=S]", "tt"),
    ("sequence[force_success[was_entry_updated{entry:$n}] script{code:n := 1} a=S]", "tt"),
    ("sequence[set_blackboard{value:5,output_key:$n} script_condition{code:n == 5} a=S]", "t"),
    ("sequence[set_blackboard{value:5,output_key:$m} unset_blackboard{key:$m} fallback[script_condition{code:m == 5} a=S]]", "t"),
    ("sequence[sleep{secs:1} a=S]", "ttt"),
    ("sequence[sleep{secs:1} a=S]", "thtt"),
    ("fallback[always_failure a=S]", "t"),
    ("sequence[always_success a=S]", "t"),
];

/// What keeps two actions apart.
const FOOTPRINT: &[(&str, &str)] = &[
    ("parallel[arm.a=RS arm.b=RS]", "tttt"),
    ("parallel[arm.a=RS arm.b=RS]", "tht"),
    ("parallel[arm.a=RS hand.b=RS]", "tt"),
    ("parallel[arm.a=RS both.b=RS hand.c=RS]", "ttttt"),
    ("parallel[both.a=RS arm.b=S hand.c=S]", "ttt"),
    ("parallel_all[arm.a=RF arm.b=RS]", "tttt"),
    ("parallel[arm.a=RS free.b=RS]", "tt"),
    ("reactive_fallback[sequence[c?FS arm.a=RS] arm.b=RRRR]", "tttt"),
    ("reactive_fallback[sequence[c?FS hand.a=RS] arm.b=RRRR]", "tttt"),
    ("reactive_fallback[sequence[c?FS free.a=RS] arm.b=RRRR]", "tttt"),
    ("reactive_fallback[sequence[c?FS a=RS] b=RRRR]", "tttt"),
    ("reactive_fallback[sequence[c?FSSSSSSS arm.a=RR] arm.b=RRR!1]", "ttttt"),
    ("reactive_fallback[sequence[c?FSSSSSSS arm.a=RR] arm.b=RRR!2]", "tttttt"),
    ("reactive_fallback[sequence[c?FSSSSSSS hand.a=RR] arm.b=RRR!2]", "tttt"),
    ("reactive_fallback[sequence[c?FSSSSSSS arm.a=RR] arm.b=RRR!9]", "ttttttt"),
    ("while_do_else[c?SSFF arm.a=RRR!1 arm.b=RRS]", "tttttt"),
    ("sequence[arm.a=RRR!2 b=S]", "thttt"),
    ("fallback[timeout{secs:1}[arm.a=RRR!1] arm.b=RS]", "tttt"),
    ("fallback[timeout{secs:1}[arm.a=RRR!1] hand.b=RS]", "tttt"),
    ("fallback[a=RX b=S]", "tt"),
    ("parallel[a=R b=X]", "t"),
];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/traces")
}

#[test]
fn trees_behave_as_written_down() {
    let writes = std::env::var_os("SFG_WRITE_TRACES").is_some();
    let mut n_traces = 0;
    for (family, cases) in families() {
        let mut seen = BTreeSet::new();
        let lines: Vec<String> = cases
            .into_iter()
            .filter(|case| seen.insert(case.clone()))
            .map(|(tree, steps)| format!("{tree} | {steps} | {}", support::run(&tree, &steps)))
            .collect();
        n_traces += lines.len();
        let path = folder().join(format!("{family}.txt"));
        if writes {
            fs::write(&path, lines.join("\n") + "\n").unwrap();
            continue;
        }
        let stored = fs::read_to_string(&path).unwrap();
        for (line, expected) in lines.iter().zip(stored.lines()) {
            assert_eq!(line, expected, "{}", path.display());
        }
        assert_eq!(lines.len(), stored.lines().count(), "{} has another number of lines", path.display());
    }
    assert!(n_traces >= 300, "{n_traces} traces");
}

#[test]
fn a_second_program_says_the_same() {
    let (mut n_checked, mut n_lines, mut wrong) = (0, 0, Vec::new());
    for (family, _) in families() {
        for line in fs::read_to_string(folder().join(format!("{family}.txt"))).unwrap().lines() {
            let parts: Vec<&str> = line.splitn(3, " | ").collect();
            n_lines += 1;
            let Some(trace) = model::run(&support::parse(parts[0]), parts[1]) else { continue };
            n_checked += 1;
            if trace != parts[2] {
                wrong.push(format!("{} | {} | {trace}", parts[0], parts[1]));
            }
        }
    }
    assert!(wrong.is_empty(), "the tables say otherwise: {wrong:#?}");
    assert!(n_checked >= 60 && 10 * n_checked >= 9 * n_lines, "{n_checked} of {n_lines} traces were checked");
}
