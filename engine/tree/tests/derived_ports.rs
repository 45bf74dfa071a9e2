//! Ports as a struct: what the derive macros declare, and when actions read.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use sfg_tree::nodes::{key, node, reactive_sequence, sequence, set_blackboard};
use sfg_tree::{
    Direction, FromLiteral as _, Halt, In, InOut, Literal, Out, Outcome, PortAction, PortWord, Ports, Progress, Registry, Shape,
    Status, Tick, TreeSpec, reason,
};
use std::sync::Arc;

#[derive(Clone, Copy, Debug, PartialEq, PortWord)]
enum Side {
    Left,
    #[word("from-above")]
    Above,
    FarRight,
}

const MOST: f64 = 2.0;

#[derive(Ports)]
struct All {
    /// Share of the grains
    /// that is poured.
    #[port(setting, default = 0.5, min = 0, max = MOST)]
    fraction: f64,
    #[port(setting, default = Side::Left)]
    side: Side,
    #[port(setting, optional)]
    title: Option<String>,
    #[port(setting, key = "level", min = -1)]
    level: Arc<i64>,
    #[port(input, optional)]
    cloud: Option<Arc<Vec<u8>>>,
    #[port(input, name = "type", key = "kind")]
    kind: In<String>,
    #[port(output)]
    fill_ml: Out<f64>,
    #[port(inout)]
    r#tries: InOut<u32>,
}

fn say(all: &All) -> String {
    format!("{} {:?} {:?} {} {:?}", all.fraction, all.side, all.title, all.level, all.cloud.as_ref().map(|cloud| cloud.len()))
}

fn registry() -> Registry<Vec<String>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.entry::<i64>("level");
    registry.entry::<String>("kind");
    registry.entry::<u32>("tries");
    registry.step_with::<All>("pour", |tick, all| {
        let text = format!("{} {}", say(&all), all.kind.get(tick)?);
        tick.context.push(text);
        let n_tries = all.tries.get(tick)? + 1;
        all.tries.set(tick, n_tries);
        all.fill_ml.set(tick, 100.0 * all.fraction);
        Ok(())
    });
    registry.condition_with::<()>("holds", |_tick, ()| Ok(true));
    registry
}

#[test]
fn a_struct_declares_its_ports() {
    let specs = All::specs();
    let names: Vec<&str> = specs.iter().map(|spec| spec.name()).collect();
    assert_eq!(names, ["fraction", "side", "title", "level", "cloud", "type", "fill_ml", "tries"]);
    let of = |name: &str| specs.iter().find(|spec| spec.name() == name).unwrap();
    assert_eq!(of("fraction").doc_text(), "Share of the grains that is poured.");
    assert_eq!((of("fraction").limits(), of("fraction").default_literal()), (Some((0.0, 2.0)), Some(&Literal::Float(0.5))));
    assert_eq!(of("level").limits(), Some((-1.0, f64::INFINITY)));
    assert_eq!(of("side").default_literal(), Some(&Literal::from("left")));
    let directions = ["cloud", "fill_ml", "tries"].map(|name| of(name).direction());
    assert_eq!(directions, [Direction::In, Direction::Out, Direction::InOut]);
    assert!(!of("title").must_be_given() && !of("type").must_be_given());
    assert_eq!(
        of("side").port_type().shape(),
        Some(&Shape::OneOf(["left", "from-above", "far_right"].map(str::to_owned).into()))
    );
}

#[test]
fn a_step_gets_its_ports_and_writes_them() {
    let spec = TreeSpec::from(sequence([node("holds"), node("pour").with("side", Side::FarRight).with("title", "x")]));
    let mut tree = registry().build(&spec).unwrap();
    tree.set_entry("level", 7_i64).unwrap();
    tree.set_entry("kind", "rice".to_owned()).unwrap();
    tree.set_entry("tries", 1_u32).unwrap();
    let mut said = Vec::new();
    assert_eq!(tree.tick(0.0, &mut said), Status::Success, "{:?}", tree.failure());
    assert_eq!(said, ["0.5 FarRight Some(\"x\") 7 None rice"]);
    assert_eq!((tree.literal("fill_ml"), tree.literal("tries")), (Some(Literal::Int(50)), Some(Literal::Int(2))));
}

#[test]
fn a_missing_input_fails_the_node() {
    let mut tree = registry().build(&TreeSpec::from(node("pour"))).unwrap();
    assert_eq!(tree.tick(0.0, &mut Vec::new()), Status::Failure);
    assert_eq!(tree.failure().unwrap().failure.reason, reason::PORT_EMPTY);
    let errors = registry().build(&TreeSpec::from(node("pour").with("fraction", 3))).unwrap_err();
    assert_eq!(errors[0].to_string(), "pour: port \"fraction\": expected 0 to 2, found 3");
}

#[test]
fn ports_are_found_in_another_order() {
    let mut registry = registry();
    let mut specs = All::specs();
    specs.reverse();
    registry.step("reversed", specs, |tick| {
        let text = say(&All::read(tick)?);
        tick.context.push(text);
        Ok(())
    });
    let mut tree = registry.build(&TreeSpec::from(node("reversed"))).unwrap();
    tree.set_entry("level", 7_i64).unwrap();
    let mut said = Vec::new();
    assert_eq!(tree.tick(0.0, &mut said), Status::Success, "{:?}", tree.failure());
    assert_eq!(said, ["0.5 Left None 7 None"]);
}

#[test]
fn words_are_read_and_written() {
    for side in [Side::Left, Side::Above, Side::FarRight] {
        assert_eq!(Side::from_literal(&side.to_literal().unwrap()), Ok(side));
        assert_eq!(Literal::from(side), side.to_literal().unwrap());
    }
    let expected = "expected one of left, from-above, far_right";
    assert_eq!(Side::from_literal(&Literal::from("up")), Err(format!("{expected}, found \"up\"")));
    assert_eq!(Side::from_literal(&Literal::Int(1)), Err(format!("{expected}, found 1")));
}

#[derive(Ports)]
struct FollowPorts {
    #[port(input)]
    cloud: Arc<Vec<u8>>,
    #[port(setting)]
    first: i64,
    #[port(setting)]
    now: In<i64>,
}

struct Follow;

impl PortAction<Vec<String>> for Follow {
    type Ports = FollowPorts;
    fn start(&mut self, tick: &mut Tick<'_, Vec<String>>, ports: &FollowPorts) -> Outcome {
        tick.context.push(format!("start {}", ports.first));
        Ok(Progress::Running)
    }
    fn poll(&mut self, tick: &mut Tick<'_, Vec<String>>, ports: &FollowPorts) -> Outcome {
        let now = ports.now.get(tick)?;
        tick.context.push(format!("{} {now}", ports.first));
        Ok(if now == 9 { Progress::Success } else { Progress::Running })
    }
    fn halt(&mut self, tick: &mut Tick<'_, Vec<String>>, ports: &FollowPorts) -> Halt {
        tick.context.push(format!("halt {} {}", ports.first, ports.cloud.len()));
        Halt::Done
    }
}

#[test]
fn an_action_reads_its_ports_when_it_starts() {
    let mut registry = Registry::<Vec<String>>::new();
    registry.entry::<Vec<u8>>("cloud");
    registry.entry::<i64>("n");
    registry.action_with("follow", || Follow);
    let follow = node("follow").with_key("first", "n").with_key("now", "n");
    let spec = TreeSpec::from(reactive_sequence([set_blackboard("seen", key("n")), follow]));
    let mut tree = registry.build(&spec).unwrap();
    tree.set_entry("cloud", vec![0_u8; 3]).unwrap();
    let mut said = Vec::new();
    for (now_secs, n) in [(0.0, 1_i64), (1.0, 2)] {
        tree.set_entry("n", n).unwrap();
        assert_eq!(tree.tick(now_secs, &mut said), Status::Running);
    }
    tree.halt(&mut said);
    assert_eq!(said, ["start 1", "1 2", "halt 1 3"]);
    // Nothing is held once it has ended: the application's handle is the only one beside the blackboard's.
    let cloud = tree.entry::<Vec<u8>>("cloud").unwrap();
    assert_eq!(Arc::strong_count(&cloud), 2);
    tree.set_entry("n", 9_i64).unwrap();
    said.clear();
    assert_eq!(tree.tick(2.0, &mut said), Status::Running);
    assert_eq!(Arc::strong_count(&cloud), 3);
    assert_eq!(tree.tick(3.0, &mut said), Status::Success);
    assert_eq!((Arc::strong_count(&cloud), said.join("; ")), (2, "start 9; 9 9".to_owned()));
}

#[derive(Ports)]
struct CountPorts {
    #[port(setting, default = 3)]
    limit: u32,
}

/// Counts ticks.
struct Count(u32);

impl PortAction<()> for Count {
    type Ports = CountPorts;
    fn start(&mut self, _tick: &mut Tick<'_, ()>, _ports: &CountPorts) -> Outcome {
        self.0 = 0;
        Ok(Progress::Running)
    }
    fn poll(&mut self, _tick: &mut Tick<'_, ()>, ports: &CountPorts) -> Outcome {
        self.0 += 1;
        Ok(if self.0 == ports.limit { Progress::Success } else { Progress::Running })
    }
    fn save(&self) -> Option<Literal> {
        Some(Literal::Int(i64::from(self.0)))
    }
    fn resume(&mut self, state: &Literal, _tick: &mut Tick<'_, ()>, _ports: &CountPorts) -> Outcome {
        self.0 = u32::from_literal(state).map_err(|message| sfg_tree::Failure::new("broken", message))?;
        Ok(Progress::Running)
    }
}

#[test]
fn an_action_with_ports_is_saved_and_resumed() {
    let mut registry = Registry::<()>::new();
    registry.action_with("count", || Count(0));
    let spec = TreeSpec::from(node("count"));
    let mut tree = registry.build(&spec).unwrap();
    for tick in 0..3 {
        assert_eq!(tree.tick(f64::from(tick), &mut ()), Status::Running);
    }
    let mut resumed = registry.build(&spec).unwrap();
    resumed.resume(&tree.save(), &mut ()).unwrap();
    assert_eq!(resumed.tick(3.0, &mut ()), Status::Success);
}
