//! What the page shows against what the recording says.

use crate::chromium::{Chromium, Page, installed};
use crate::recorded::Recorded;
use crate::{Random, Serving, root, sfg, shots};
use serde_json::{Value, json};
use sfg_kinematics::RobotModel;
use sfg_types::{HandSide, Point, RejectionReason};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

const SEED: u64 = 20_260_704;
const WIDTH: u32 = 1600;
const HEIGHT: u32 = 1000;
/// How far a link may be drawn from where kinematics sees it, CSS pixels.
const MAX_MISS_PX: f64 = 5.0;

/// Records the pour up to the end of `stop_after`.
fn record(folder: &Path, name: &str, seed: &str, stop_after: &str) -> Recorded {
    let scenario = root().join("scenarios/01_pour.yaml");
    let code = sfg(folder, &["run", scenario.to_str().unwrap(), "--seed", seed, "--stop-after", stop_after, "--out", name]);
    assert_eq!(code, 130, "a run that was stopped after {stop_after}");
    Recorded::read(&folder.join(name).join("run.mcap"))
}

fn open<'a>(browser: &'a mut Chromium, url: &str, scheme: &str) -> Page<'a> {
    let mut page = browser.page(WIDTH, HEIGHT);
    page.prefer(scheme);
    page.open(url);
    wait_until_ready(&mut page);
    page
}

fn wait_until_ready(page: &mut Page<'_>) {
    page.wait_for("document.body.dataset.state === 'ready' && sfg.panels[0].scene && sfg.panels[0].scene.run.header");
}

fn seek(page: &mut Page<'_>, t: f64) {
    page.eval(&format!("sfg.pause(); sfg.seek({t:?})"));
    page.settle();
}

/// Path and status of each node as the page's elements have it; nodes out of sight are scrolled in.
fn shown_statuses(page: &mut Page<'_>, paths: &BTreeSet<String>) -> BTreeMap<String, String> {
    let mut shown = BTreeMap::new();
    let in_sight = "[...document.querySelectorAll('section.run[data-run=\"0\"] .node[data-path]')].map((node) => [node.dataset.path, node.dataset.status])";
    for path in std::iter::once(None).chain(paths.iter().map(Some)) {
        if path.is_some_and(|path| shown.contains_key(path)) {
            continue;
        }
        if let Some(path) = path {
            page.eval(&format!("void sfg.panels[0].tree.reveal({})", json!(path)));
            page.settle();
        }
        for node in page.eval(in_sight).as_array().unwrap() {
            shown.insert(node[0].as_str().unwrap().to_owned(), node[1].as_str().unwrap().to_owned());
        }
    }
    shown
}

/// The colours of the tree at random times and right after random changes.
fn check_statuses(page: &mut Page<'_>, recorded: &Recorded) {
    let definition = &recorded.all("/tree/definition")[0].1["nodes"];
    let paths: BTreeSet<String> =
        definition.as_array().unwrap().iter().map(|node| node["path"].as_str().unwrap().to_owned()).collect();
    assert!(paths.len() > 10, "{paths:?}");
    let (changes, mut random) = (recorded.change_times(), Random(SEED));
    let mut seen = BTreeSet::new();
    for round in 0..20 {
        let t = if round % 2 == 0 {
            random.share() * recorded.duration()
        } else {
            changes[(random.share() * changes.len() as f64) as usize] + 1e-4
        };
        seek(page, t);
        let (told, shown) = (recorded.statuses(t), shown_statuses(page, &paths));
        for path in &paths {
            let told = told.get(path).map_or("idle", String::as_str);
            assert_eq!(shown.get(path).map(String::as_str), Some(told), "{path} at {t} s");
            seen.insert(told.to_owned());
        }
    }
    assert!(seen.len() >= 3, "the times are too much alike: {seen:?}");
}

/// Five links of the arm against forward kinematics and the page's own projection.
fn check_links(page: &mut Page<'_>, recorded: &Recorded) {
    let model = RobotModel::load(&root().join("scenarios/robots/curi.yaml")).unwrap();
    let links = ["panda_left_link2", "panda_left_link4", "panda_left_link6", "panda_left_link7", "left_palm"];
    let mut places = Vec::new();
    for t in [0.35 * recorded.duration(), 0.8 * recorded.duration()] {
        seek(page, t);
        let sample = recorded.latest("/robot", t).unwrap();
        let arm_q: Vec<f64> = sample["q"].as_array().unwrap().iter().map(|q| q.as_f64().unwrap()).collect();
        let poses = model.link_poses(&model.q_with_arm(HandSide::Left, &arm_q));
        let view = page.eval("(() => { const s = sfg.panels[0].scene; return {m: [...s.viewProjection()], size: [s.canvas.clientWidth, s.canvas.clientHeight]}; })()");
        for link in links {
            let idx = model.tree.link_idx(link).unwrap();
            let expected = project(&view, &Point::from(poses[idx].translation.vector));
            let shown = page.eval(&format!(
                "(() => {{ const s = sfg.panels[0].scene; return s.project(s.linkPose({}).position); }})()",
                json!(link)
            ));
            let miss = (shown["x"].as_f64().unwrap() - expected[0]).hypot(shown["y"].as_f64().unwrap() - expected[1]);
            assert!(miss <= MAX_MISS_PX, "{link} at {t} s is drawn {miss:.2} px beside {expected:?}");
            println!("{link} at {t:.2} s: {miss:.3} px from forward kinematics");
            places.push(expected);
        }
    }
    let moved = (0..links.len()).filter(|i| (places[*i][0] - places[i + links.len()][0]).abs() > 2.0 * MAX_MISS_PX);
    assert!(moved.count() >= 2, "the arm hardly moved between the two moments");
}

/// A point of the base frame in CSS pixels of the canvas.
fn project(view: &Value, point: &Point) -> [f64; 2] {
    let m: Vec<f64> = view["m"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
    let size = [0, 1].map(|i| view["size"][i].as_f64().unwrap());
    let row = |r: usize| m[r] * point.x + m[4 + r] * point.y + m[8 + r] * point.z + m[12 + r];
    [(0.5 + 0.5 * row(0) / row(3)) * size[0], (0.5 - 0.5 * row(1) / row(3)) * size[1]]
}

/// The mouse over a rejected palm pose: the page says what the report says.
fn check_hover(page: &mut Page<'_>, report: &Value, recorded: &Recorded) {
    let t = recorded.all("/candidates").iter().rfind(|(_, message)| !message["chosen"].is_null()).unwrap().0;
    seek(page, t + 0.002);
    page.eval("sfg.panels[0].scene.preset('grasp')");
    page.settle();
    let stage = report["stages"].as_array().unwrap().iter().rfind(|stage| stage["stage"] == "select_palm_pose").unwrap();
    let rejected = stage["details"]["rejected"].as_array().unwrap();
    // The places of all palm poses inside the view; one is taken that stands alone.
    let places = page.eval("(() => { const s = sfg.panels[0].scene; return s.candidates.list.map((c) => s.project(c.base_from_palm.translation)); })()");
    let place = |idx: u64| {
        let place = &places[idx as usize];
        [place["x"].as_f64().unwrap(), place["y"].as_f64().unwrap()]
    };
    let n = places.as_array().unwrap().len() as u64;
    let lonely = |idx: u64| {
        let [x, y] = place(idx);
        (0..n)
            .filter(|other| *other != idx)
            .map(|other| (place(other)[0] - x).hypot(place(other)[1] - y))
            .fold(f64::MAX, f64::min)
    };
    let frame = page.eval(
        "(() => { const r = sfg.panels[0].scene.canvas.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; })()",
    );
    let frame = [0, 1, 2, 3].map(|i| frame[i].as_f64().unwrap());
    let is_inside = |[x, y]: [f64; 2]| x > 5.0 && y > 45.0 && x < frame[2] - 5.0 && y < frame[3] - 45.0;
    let best = rejected
        .iter()
        // A pose that cannot be used says more than one that was merely not the best.
        .map(|one| (one["reason"]["why"] != "ranked_lower", one["candidate_idx"].as_u64().unwrap(), &one["reason"]))
        .filter(|(_, idx, _)| is_inside(place(*idx)) && lonely(*idx) > 2.0)
        .max_by(|a, b| a.0.cmp(&b.0).then(lonely(a.1).total_cmp(&lonely(b.1))));
    let (_, idx, reason) = best.expect("a rejected palm pose that stands alone");
    let text = serde_json::from_value::<RejectionReason>(reason.clone()).unwrap().to_string();
    let [x, y] = place(idx);
    page.point_at(frame[0] + x, frame[1] + y);
    page.wait_for("!document.getElementById('scene-tooltip').hidden");
    let tip = page.eval(
        "(() => { const tip = document.getElementById('scene-tooltip'); return [tip.dataset.candidate, tip.textContent]; })()",
    );
    assert_eq!(tip[0], json!(idx.to_string()), "{tip}");
    assert!(tip[1].as_str().unwrap().contains(&text), "{tip} does not say {text:?}");
    println!("palm pose {idx}: {text}");
    page.screenshot(&shots().join("hover.png"));
    page.point_at(frame[0] + 3.0, frame[1] + frame[3] - 3.0);
    page.wait_for("document.getElementById('scene-tooltip').hidden");
    page.eval("sfg.panels[0].scene.preset('home')");
}

/// All that can differ between two ways to the same moment.
fn state(page: &mut Page<'_>) -> Value {
    page.settle();
    page.eval(
        "({t: sfg.t, q: [...sfg.runs[0].robotAt(sfg.t).q],
           nodes: [...document.querySelectorAll('section.run[data-run=\"0\"] .node[data-path]')].map((n) => [n.dataset.path, n.dataset.status]),
           board: [...document.querySelectorAll('section.run[data-run=\"0\"] .blackboard tr[data-key]')].map((r) => [r.dataset.key, r.dataset.value]),
           palm: sfg.panels[0].scene.linkPose('left_palm')})",
    )
}

/// Plays from `from` until `until` has passed, and holds there.
fn play(page: &mut Page<'_>, from: f64, until: f64) -> Value {
    seek(page, from);
    page.eval("sfg.play()");
    page.wait_for(&format!("sfg.t > {until:?}"));
    page.eval("sfg.pause()");
    state(page)
}

/// Playing to a moment, jumping near it and playing the rest, and jumping to it give the same page.
fn check_seeking(page: &mut Page<'_>, recorded: &Recorded) {
    let middle = 0.6 * recorded.duration();
    for from in [middle - 2.0, middle - 0.4] {
        let played = play(page, from, middle);
        let t = played["t"].as_f64().unwrap();
        assert!(t >= middle && t < recorded.duration(), "{t}");
        // From elsewhere, so that nothing of the playing is left.
        seek(page, recorded.duration());
        seek(page, 0.0);
        seek(page, t);
        assert_eq!(state(page), played, "jumping to {t} s shows something else than playing there from {from} s");
    }
}

fn assert_silent(page: &mut Page<'_>) {
    let complaints = page.complaints();
    assert!(complaints.is_empty(), "the console is not empty: {complaints:#?}");
}

#[test]
fn a_recording_is_shown_as_it_was_recorded() {
    let Some(program) = installed() else {
        println!("passed over: there is no Chromium here");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let recorded = record(folder.path(), "first", "3", "lift");
    let report: Value = serde_json::from_slice(&std::fs::read(folder.path().join("first/report.json")).unwrap()).unwrap();
    let serving = Serving::start(folder.path(), &["view", "first", "--port", "0"]);
    let mut browser = Chromium::start(&program, &[]);
    let mut page = open(&mut browser, &serving.url, "light");
    check_statuses(&mut page, &recorded);
    check_links(&mut page, &recorded);
    check_hover(&mut page, &report, &recorded);
    check_seeking(&mut page, &recorded);
    seek(&mut page, 0.9 * recorded.duration());
    page.screenshot(&shots().join("recording-light.png"));
    page.prefer("dark");
    // Another moment of the same page alone would not load it again.
    page.open("about:blank");
    page.open(&format!("{}#t={:.2}", serving.url, 0.9 * recorded.duration()));
    wait_until_ready(&mut page);
    page.wait_for("document.documentElement.dataset.theme === 'dark'");
    page.wait_for(&format!("Math.abs(sfg.t - {:?}) < 0.01", 0.9 * recorded.duration()));
    page.settle();
    page.screenshot(&shots().join("recording-dark.png"));
    page.press("?", "Slash");
    page.settle();
    page.screenshot(&shots().join("help.png"));
    assert_silent(&mut page);
}

#[test]
fn two_recordings_stand_side_by_side() {
    let Some(program) = installed() else {
        println!("passed over: there is no Chromium here");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let recorded = record(folder.path(), "first", "3", "reach_palm_pose");
    record(folder.path(), "second", "4", "reach_palm_pose");
    let serving = Serving::start(folder.path(), &["view", "first", "second", "--port", "0"]);
    let mut browser = Chromium::start(&program, &[]);
    let mut page = open(&mut browser, &serving.url, "light");
    page.wait_for("sfg.panels.length === 2 && sfg.panels[1].scene && sfg.panels[1].scene.run.header");
    seek(&mut page, 0.5 * recorded.duration());
    let links = page.eval("sfg.panels.map((panel) => panel.scene.linkPose('left_palm').position)");
    assert_ne!(links[0], links[1], "other seeds take the arm elsewhere");
    // They reach their palm poses at other times: up to the earlier one all is the same.
    page.eval("document.getElementById('first-difference').click()");
    let (t, told) = (page.eval("sfg.t").as_f64().unwrap(), page.eval("document.getElementById('notice').textContent"));
    assert!(t > 1.0 && t < recorded.duration() && told.as_str().unwrap().contains("reach_palm_pose"), "{t} s: {told}");
    seek(&mut page, 0.5 * recorded.duration());
    page.screenshot(&shots().join("two-runs.png"));
    assert_silent(&mut page);
}

#[test]
fn a_browser_without_webgl_is_told_so_and_shows_the_rest() {
    let Some(program) = installed() else {
        println!("passed over: there is no Chromium here");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let recorded = record(folder.path(), "first", "3", "select_palm_pose");
    let serving = Serving::start(folder.path(), &["view", "first", "--port", "0"]);
    let mut browser = Chromium::start(&program, &["--disable-3d-apis"]);
    let mut page = open(&mut browser, &serving.url, "light");
    let said = page.eval("document.querySelector('.view-message').textContent");
    assert!(said.as_str().unwrap().contains("WebGL2"), "{said}");
    seek(&mut page, recorded.duration());
    let told = recorded.statuses(recorded.duration());
    for (path, shown) in shown_statuses(&mut page, &BTreeSet::new()) {
        assert_eq!(Some(&shown), told.get(&path).or(Some(&"idle".to_owned())), "{path}");
    }
    assert_silent(&mut page);
}

#[test]
fn a_live_run_is_shown_as_it_is_recorded() {
    let Some(program) = installed() else {
        println!("passed over: there is no Chromium here");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let scenario = root().join("scenarios/01_pour.yaml");
    let args = ["run", scenario.to_str().unwrap(), "--seed", "3", "--stop-after", "lift", "--out", "live", "--view", "0"];
    // It waits for the page, so that nothing is missed.
    let mut serving = Serving::start(folder.path(), &[&args[..], &["--control", "--pause"]].concat());
    let mut browser = Chromium::start(&program, &[]);
    let mut page = open(&mut browser, &serving.url, "light");
    // It stops before the hand closes, so that something is under way at the first look however slow this browser is.
    let close_hand = "sequence/retry/functional_grasp/sequence/close_hand";
    page.eval(&format!("sfg.control.order({{command: 'break', node: '{close_hand}', at: 'start', on: true}})"));
    page.wait_for("sfg.control.state.breakpoints.length === 1");
    page.eval("document.getElementById('control-continue').click()");
    page.wait_for("document.getElementById('control-state').textContent.includes('before sequence')");
    page.wait_for("sfg.t > sfg.runs[0].changeFrom(sfg.runs[0].duration, -1) + 0.1");
    // All that belongs to this moment has come, which is not sure of the last one.
    let hold = |page: &mut Page<'_>| {
        page.eval("sfg.pause()");
        page.eval("sfg.seek(sfg.t - 0.1)");
        state(page)
    };
    let mut held = vec![hold(&mut page)];
    page.screenshot(&shots().join("live.png"));
    page.eval("document.getElementById('control-continue').click()");
    page.eval("document.getElementById('go-live').click()");
    // What is shown while the run goes on stands still when it is held.
    while held.len() < 4 && serving.ended().is_none() && page.eval("document.body.dataset.live") == "true" {
        held.push(hold(&mut page));
        assert_silent(&mut page);
        page.eval("document.getElementById('go-live').click()");
        std::thread::sleep(Duration::from_millis(300));
    }
    // The page stays as long as somebody looks at it.
    drop(page);
    drop(browser);
    assert_eq!(serving.wait(), Some(130), "a run that was stopped after lift");
    let recorded = Recorded::read(&folder.path().join("live/run.mcap"));
    let mut running = BTreeSet::new();
    for state in &held {
        let (t, nodes) = (state["t"].as_f64().unwrap(), state["nodes"].as_array().unwrap());
        let told = recorded.statuses(t);
        assert!(!nodes.is_empty());
        for node in nodes {
            let told = told.get(node[0].as_str().unwrap()).map_or("idle", String::as_str);
            assert_eq!(node[1], told, "{} at {t} s", node[0]);
            if told == "running" {
                running.insert(node[0].as_str().unwrap().to_owned());
            }
        }
        let sample = recorded.latest("/robot", t).unwrap();
        assert!(sample["q"].as_array().unwrap().len() == 7, "{sample}");
    }
    assert!(!running.is_empty(), "nothing ran while the page looked on");
}
