//! A tree that is written and read again is the same tree.
#![cfg(feature = "xml")]
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use sfg_tree::xml::{ImportOptions, export, import};
use sfg_tree::{
    ConditionSpec, Direction, Literal, NodeClass, NodeModel, NodeSpec, PortSpec, SubtreePort, SubtreeSpec, TreeSpec, When,
};

/// A small generator of its own: the same numbers everywhere.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % end
    }

    fn one_of<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.below(items.len())]
    }

    fn key(&mut self) -> &'static str {
        self.one_of(&["cup", "@cup", "_private", "goal_2", "x"])
    }

    /// Texts with everything that XML, scripts and other nodes give a meaning to.
    fn text(&mut self) -> String {
        const PIECES: [&str; 16] =
            ["a", " ", "\"", "'", "<", "&&", "&amp;", ">", "\n", "\t", "\r\n", ";", "42", "\u{fc}\u{1f600}", "{x", "]]>"];
        (0..self.below(6)).map(|_| self.one_of(&PIECES)).collect()
    }

    fn int(&mut self) -> i64 {
        self.below(2_000) as i64 - 1_000
    }

    fn float(&mut self) -> f64 {
        self.int() as f64 / self.one_of(&[1.0, 3.0, 1e9, 1e-9])
    }

    fn millis(&mut self) -> f64 {
        self.below(100_000) as f64 / 1000.0
    }

    fn result(&mut self) -> &'static str {
        self.one_of(&["failure", "success", "skipped"])
    }
}

const SUBTREES: [&str; 3] = ["Fetch", "T\u{fc}r", "MainTree"];

/// The tree `level` may use the subtrees after it, so that none uses itself.
fn node(numbers: &mut Numbers, depth: usize, level: usize) -> NodeSpec {
    let node = if depth == 0 { leaf(numbers, level) } else { inner(numbers, depth - 1, level) };
    dressed(numbers, node)
}

/// A title and scripts at random.
fn dressed(numbers: &mut Numbers, mut node: NodeSpec) -> NodeSpec {
    if numbers.below(4) == 0 {
        node = node.title(format!("t{}{}", numbers.below(usize::MAX), numbers.text()));
    }
    if numbers.below(4) == 0 {
        let (first, second) = (numbers.below(8), numbers.below(8));
        for when_idx in [Some(first), (second != first).then_some(second)].into_iter().flatten() {
            node.conditions.push(ConditionSpec { when: When::ALL[when_idx], script: numbers.text(), location: 0 });
        }
    }
    node
}

fn leaf(numbers: &mut Numbers, level: usize) -> NodeSpec {
    match numbers.below(10) {
        0 => NodeSpec::new("script").with("code", numbers.text()),
        1 => NodeSpec::new("script_condition").with("code", numbers.text()),
        2 => NodeSpec::new("set_blackboard").with("value", numbers.text()).with_key("output_key", numbers.key()),
        3 => NodeSpec::new("set_blackboard").with_key("output_key", numbers.key()).with_key("value", numbers.key()),
        4 => NodeSpec::new("unset_blackboard").with_key("key", numbers.key()),
        5 => NodeSpec::new("sleep").with("secs", numbers.millis()),
        6 => NodeSpec::new("was_entry_updated").with_key("entry", numbers.key()),
        7 if level < SUBTREES.len() => {
            let mut node = NodeSpec::subtree(SUBTREES[level + numbers.below(SUBTREES.len() - level)]);
            node.is_autoremapped = numbers.below(2) == 0;
            // The ports of `subtree` below, always given.
            node = node.with_key("goal", numbers.key()).with("count", numbers.int()).with("share", numbers.float());
            node.with("words", format!("w{}", numbers.text()))
        }
        8 => NodeSpec::new(numbers.one_of(&["always_success", "always_failure"])),
        _ => {
            let name = numbers.one_of(&["lift", "Lift-Arm", "h\u{f6}her", "open_hand"]);
            NodeSpec::new(name).with_key("goal", numbers.key()).with("text", numbers.text())
        }
    }
}

fn inner(numbers: &mut Numbers, depth: usize, level: usize) -> NodeSpec {
    const CONTROLS: [&str; 12] = [
        "sequence",
        "async_sequence",
        "sequence_with_memory",
        "fallback",
        "async_fallback",
        "reactive_sequence",
        "reactive_fallback",
        "if_then_else",
        "while_do_else",
        "parallel",
        "parallel_all",
        "PipelineSequence",
    ];
    const DECORATORS: [&str; 4] = ["inverter", "force_success", "force_failure", "keep_running_until_failure"];
    let mut n_children = 1;
    let node = match numbers.below(14) {
        0 => NodeSpec::new(numbers.one_of(&DECORATORS)),
        1 => NodeSpec::new("retry").with("attempts", numbers.int()),
        2 => NodeSpec::new("repeat").with_key("times", numbers.key()),
        3 => NodeSpec::new(numbers.one_of(&["timeout", "delay"])).with("secs", numbers.millis()),
        4 => NodeSpec::new("run_once").with("then_skip", numbers.below(2) == 0),
        5 => NodeSpec::new("precondition").with("if", numbers.text()).with("else", numbers.result()),
        6 => {
            let over: Literal = match numbers.below(5) {
                0 => vec![true, false].into(),
                1 => vec![numbers.int(), 3].into(),
                2 => vec![numbers.float()].into(),
                3 => Literal::List(Vec::new()),
                _ => vec!["a", "", "b c"].into(),
            };
            NodeSpec::new("loop").with("if_empty", numbers.result()).with("over", over).with_key("item", numbers.key())
        }
        7 => NodeSpec::new("loop").with_key("over", "heights").with_key("item", numbers.key()),
        8 => NodeSpec::new(numbers.one_of(&["skip_unless_updated", "wait_value_update"])).with_key("entry", numbers.key()),
        9 => {
            let n_cases = 2 + numbers.below(5);
            n_children = n_cases + 1;
            let cases: Vec<String> = (0..n_cases).map(|_| numbers.text()).collect();
            NodeSpec::new("switch").with("cases", cases).with_key("variable", numbers.key())
        }
        10 => {
            n_children = 2 + numbers.below(2);
            NodeSpec::new("try_catch").with("catch_on_halt", true)
        }
        11 => {
            n_children = 2;
            NodeSpec::new("parallel").with("success", -1).with("failure", numbers.int())
        }
        _ => {
            n_children = 1 + numbers.below(3);
            NodeSpec::new(numbers.one_of(&CONTROLS))
        }
    };
    let children: Vec<NodeSpec> = (0..n_children)
        .map(|_| {
            let depth = numbers.below(depth + 1);
            self::node(numbers, depth, level)
        })
        .collect();
    node.children(children)
}

fn subtree(numbers: &mut Numbers, level: usize) -> SubtreeSpec {
    let port = |name: &str, direction, default| SubtreePort { name: name.to_owned(), direction, default, location: 0 };
    let ports = vec![
        port("goal", Direction::InOut, None),
        port("count", Direction::In, Some(Literal::Int(numbers.int()))),
        port("share", Direction::In, Some(Literal::Float(numbers.float()))),
        port("words", Direction::Out, Some(Literal::Text(format!("w{}", numbers.text())))),
    ];
    SubtreeSpec { name: SUBTREES[level].to_owned(), ports, is_open: true, root: tree(numbers, level + 1), location: 0 }
}

/// A tree with a node that says which type the list in `heights` has.
fn tree(numbers: &mut Numbers, level: usize) -> NodeSpec {
    let depth = 1 + numbers.below(4);
    NodeSpec::new("sequence").child(NodeSpec::new("find").with_key("heights", "heights")).child(node(numbers, depth, level))
}

fn without_locations(spec: &mut TreeSpec) {
    fn clear(node: &mut NodeSpec) {
        node.location = 0;
        for setting in &mut node.ports {
            (setting.location, setting.name_location) = (0, 0);
        }
        node.conditions.iter_mut().for_each(|condition| condition.location = 0);
        node.children.iter_mut().for_each(clear);
    }
    clear(&mut spec.root);
    for subtree in &mut spec.subtrees {
        subtree.location = 0;
        subtree.ports.iter_mut().for_each(|port| port.location = 0);
        clear(&mut subtree.root);
    }
}

#[test]
fn a_written_tree_reads_as_itself() {
    let mut find = NodeModel::new("find", NodeClass::Action, vec![PortSpec::output::<Vec<f64>>("heights")]);
    find.doc("Says < & > \"to\" an editor.");
    let mut numbers = Numbers(1);
    let mut n_refused = 0;
    for round in 0..2_000 {
        let mut spec = TreeSpec::new(tree(&mut numbers, 0));
        spec.allows_unwritten_keys = true;
        spec.has_untyped_texts = true;
        spec.subtrees = (0..SUBTREES.len()).map(|level| subtree(&mut numbers, level)).collect();
        let text = match export(&spec, std::slice::from_ref(&find)) {
            Ok(text) => text,
            // Only texts that other nodes read as something else: `{x...}`, numbers for ports of subtrees.
            Err(problems) => {
                let is_text = problems.iter().all(|problem| problem.to_string().contains("way to write this"));
                assert!(is_text, "round {round}: {}", problems[0]);
                n_refused += 1;
                continue;
            }
        };
        match import(&text, &ImportOptions::default()) {
            Ok(mut tree) => {
                without_locations(&mut tree.spec);
                assert_eq!(format!("{:#?}", tree.spec), format!("{spec:#?}"), "round {round}:\n{text}");
                assert!(tree.warnings.is_empty(), "round {round}: {}", tree.warnings[0]);
            }
            Err(problems) => panic!("round {round}: {}\n{text}", problems[0]),
        }
    }
    assert!(n_refused < 100, "{n_refused} of 2000 trees could not be written");
}
