//! Scripted leaves and trees written as one line.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, reason = "shared by several test binaries; tests fail by panicking")]

use sfg_tree::{Action, Failure, Halt, Literal, NodeSpec, Outcome, PortSpec, Progress, Registry, Status, Tick, Tree, TreeSpec};

/// What happened to leaves: `+a` started, `.a` polled, `-a` halted.
pub type Events = Vec<String>;

/// Letters, one per tick: R running, S success, F failure, K skipped, X panic. `|` separates activations; the last letter of an
/// activation and the last activation repeat. `!2` at the end: a halt is done when it is asked for the third time.
#[derive(Default)]
struct Scripted {
    activation_idx: usize,
    letter_idx: usize,
    is_before_first: bool,
    n_halts: usize,
}

impl Scripted {
    fn letter(&mut self, tick: &mut Tick<'_, Events>) -> Outcome {
        let script = tick.get::<String>("script")?;
        let script = script.split('!').next().unwrap_or(&script);
        let activations: Vec<&str> = script.split('|').collect();
        let letters = activations[self.activation_idx.min(activations.len() - 1)].as_bytes();
        match letters[self.letter_idx.min(letters.len() - 1)] {
            b'R' => Ok(Progress::Running),
            b'S' => Ok(Progress::Success),
            b'K' => Ok(Progress::Skipped),
            b'F' => Err(Failure::new(tick.get::<String>("reason")?, "scripted")),
            _ => panic!("scripted panic"),
        }
    }
}

impl Action<Events> for Scripted {
    fn start(&mut self, tick: &mut Tick<'_, Events>) -> Outcome {
        let name = tick.get::<String>("name_")?;
        tick.context.push(format!("+{name}"));
        self.activation_idx = if self.is_before_first { 0 } else { self.activation_idx + 1 };
        self.is_before_first = false;
        self.letter_idx = 0;
        self.letter(tick)
    }
    fn poll(&mut self, tick: &mut Tick<'_, Events>) -> Outcome {
        let name = tick.get::<String>("name_")?;
        tick.context.push(format!(".{name}"));
        self.letter_idx += 1;
        self.letter(tick)
    }
    fn halt(&mut self, tick: &mut Tick<'_, Events>) -> Halt {
        let (name, script) = (tick.get::<String>("name_").unwrap(), tick.get::<String>("script").unwrap());
        tick.context.push(format!("-{name}"));
        let n_needed = script.split_once('!').map_or(0, |(_, n)| n.parse().unwrap());
        if self.n_halts < n_needed {
            self.n_halts += 1;
            return Halt::Pending { within_secs: 3.0 };
        }
        self.n_halts = 0;
        Halt::Done
    }
    fn save(&self) -> Option<Literal> {
        let numbers = [self.activation_idx, self.letter_idx].map(|number| i64::try_from(number).unwrap());
        Some(Literal::from(numbers.to_vec()))
    }
    fn resume(&mut self, state: &Literal, tick: &mut Tick<'_, Events>) -> Outcome {
        let Literal::List(numbers) = state else { return Err(Failure::new("broken", "")) };
        let number = |literal: &Literal| match literal {
            Literal::Int(number) => usize::try_from(*number).unwrap(),
            _ => 0,
        };
        (self.activation_idx, self.letter_idx) = (number(&numbers[0]), number(&numbers[1]));
        self.is_before_first = false;
        let name = tick.get::<String>("name_")?;
        tick.context.push(format!("~{name}"));
        Ok(Progress::Running)
    }
}

pub fn registry() -> Registry<Events> {
    let mut registry = Registry::new();
    let ports = || {
        [
            PortSpec::setting::<String>("name_"),
            PortSpec::setting::<String>("script"),
            PortSpec::setting::<String>("reason").default_value("broken"),
        ]
    };
    let make = || Scripted { is_before_first: true, ..Scripted::default() };
    registry.action("scripted", ports(), make);
    registry.action("free", ports(), make).occupies(Vec::<String>::new());
    registry.action("arm", ports(), make).occupies(["arm"]);
    registry.action("hand", ports(), make).occupies(["hand"]);
    registry.action("both", ports(), make).occupies(["arm", "hand"]);
    // A condition reads its script by the number of the tick.
    registry.condition("condition", ports(), |tick| {
        let (name, script) = (tick.get::<String>("name_")?, tick.get::<String>("script")?);
        tick.context.push(format!("?{name}"));
        let letter_idx = usize::try_from(tick.tick_idx()).unwrap() - 1;
        Ok(script.as_bytes()[letter_idx.min(script.len() - 1)] == b'S')
    });
    registry
}

/// `sequence[a=RS b=F]`, `retry{attempts:3,on:slipped}[a=F/slipped]`, `sequence[c?SSF a=RRR]`; `arm.a=R` occupies the arm.
/// `{variable:$n}` is a key, `{cases:1+2}` a list; the entry `n` begins with 0.
pub fn parse(text: &str) -> NodeSpec {
    let mut rest = text;
    let node = parse_node(&mut rest);
    assert!(rest.trim().is_empty(), "left over: {rest:?}");
    node
}

fn parse_node(rest: &mut &str) -> NodeSpec {
    *rest = rest.trim_start();
    let end = rest.find(['=', '?', '[', '{', ']', ' ']).unwrap_or(rest.len());
    if rest[end..].starts_with([']', ' ']) || end == rest.len() {
        let name = &rest[..end];
        *rest = &rest[end..];
        return NodeSpec::new(name);
    }
    let (name, mark) = (&rest[..end], rest.as_bytes()[end]);
    *rest = &rest[end..];
    if mark == b'=' || mark == b'?' {
        let end = rest.find([' ', ']']).unwrap_or(rest.len());
        let (script, reason) = rest[1..end].split_once('/').unwrap_or((&rest[1..end], "broken"));
        *rest = &rest[end..];
        let (kind, name) = match name.split_once('.') {
            Some((kind, name)) => (kind, name),
            None if mark == b'=' => ("scripted", name),
            None => ("condition", name),
        };
        return NodeSpec::new(kind).title(name).with("name_", name).with("script", script).with("reason", reason);
    }
    let mut node = NodeSpec::new(name);
    if mark == b'{' {
        let end = rest.find('}').unwrap();
        for pair in rest[1..end].split(',') {
            let (port, value) = pair.split_once(':').unwrap();
            if let Some(key) = value.strip_prefix('$') {
                node = node.with_key(port, key);
                continue;
            }
            let literal = if ["on", "cases", "over"].contains(&port) {
                Literal::from(value.split('+').collect::<Vec<_>>())
            } else if let Ok(truth) = value.parse::<bool>() {
                Literal::Bool(truth)
            } else if let Ok(number) = value.parse::<i64>() {
                Literal::Int(number)
            } else {
                value.parse::<f64>().map_or_else(|_text| Literal::from(value), Literal::Float)
            };
            node = node.with(port, literal);
        }
        *rest = &rest[end + 1..];
        if !rest.starts_with('[') {
            return node;
        }
    }
    *rest = &rest[1..];
    while !rest.trim_start().starts_with(']') {
        node = node.child(parse_node(rest));
    }
    *rest = &rest.trim_start()[1..];
    node
}

/// A tree from a seeded generator.
pub fn random_tree(next: &mut impl FnMut(u64) -> u64, depth: u32, n_leaves: &mut u32) -> String {
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
        "keep_running_until_failure",
        "delay{secs:1}",
        "rate_limit{hz:0.5}",
        "run_once",
        "async_sequence",
        "async_fallback",
        "sequence_with_memory",
        "parallel_all",
        "if_then_else",
        "while_do_else",
        "try_catch",
        "try_catch{catch_on_halt:true}",
        "recover{attempts:2,on:broken}",
    ];
    let kind_idx = usize::try_from(next(24)).unwrap();
    let n_children = match kind_idx {
        0..6 | 15..19 => 1 + next(3),
        19..23 => 2 + next(2),
        23 => 2,
        _ => 1,
    };
    let children: Vec<String> = (0..n_children).map(|_| random_tree(next, depth - 1, n_leaves)).collect();
    format!("{}[{}]", kinds[kind_idx], children.join(" "))
}

/// Numbers below a bound, the same for the same seed.
pub fn numbers(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut random = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    move |bound| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random % bound
    }
}

pub fn build(text: &str) -> Tree<Events> {
    registry().build(&TreeSpec::new(parse(text)).entry("n", 0)).unwrap()
}

pub fn letter(status: Status) -> char {
    match status {
        Status::Idle => 'I',
        Status::Running => 'R',
        Status::Success => 'S',
        Status::Failure => 'F',
        Status::Skipped => 'K',
    }
}

/// Runs `steps` (`t` = tick, one second each; `h` = halt) and gives the trace: events and result of each step, joined by ` ; `.
pub fn run(text: &str, steps: &str) -> String {
    let mut tree = build(text);
    let (mut now_secs, mut trace) = (0.0, Vec::new());
    for step in steps.chars() {
        let mut events = Events::new();
        let result = if step == 't' {
            let status = tree.tick(now_secs, &mut events);
            now_secs += 1.0;
            letter(status)
        } else {
            tree.halt(&mut events);
            for id in 0..u32::try_from(tree.n_nodes()).unwrap() {
                assert_eq!(tree.status(id), Status::Idle, "{} is not idle after halt", tree.path(id));
            }
            'h'
        };
        events.push(result.to_string());
        trace.push(events.join(" "));
    }
    trace.join(" ; ")
}
