//! Loading real libraries, good and bad. Cargo builds them as the examples of this crate.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use serde_json::{Value, json};
use sfg_plugin::testing::{self, PoseScene};
use sfg_plugin::{PluginContext, PluginError, PoseGenerator};
use sfg_plugin_host::{Contract, HostError, Registry, load_library};
use sfg_types::{GraspType, HandProfile, HandSide, PalmPoseCandidate, Pose, SynergyCoordinates};
use std::path::{Path, PathBuf};

// The same source as the library, compiled into this test: what the library answers is compared with it.
#[path = "../examples/exported_pose.rs"]
mod exported_pose;

fn library(example: &str) -> PathBuf {
    let file = format!("{}{example}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let built = std::env::current_exe().unwrap().parent().unwrap().with_file_name("examples").join(file);
    assert!(built.is_file(), "{built:?} is missing; `cargo test -p sfg-plugin-host` without `--test` builds it");
    built
}

fn context<'a>(hand: &'a HandProfile, params: &'a Value) -> PluginContext<'a> {
    PluginContext { params, scenarios_dir: Path::new("scenarios"), hand, hand_side: HandSide::Left, seed: 42 }
}

fn tower(params: &Value) -> Result<Box<dyn PoseGenerator>, HostError> {
    let mut registry = Registry::new();
    let added = registry.add_library(&load_library(&library("exported_pose")).unwrap()).unwrap();
    assert_eq!(added, [(Contract::PoseGenerator, "tower".to_owned())]);
    registry.make_pose_generator("tower", &context(&testing::hand_profile(), params))
}

fn blank() -> [PalmPoseCandidate; 3] {
    std::array::from_fn(|_| PalmPoseCandidate {
        base_from_palm: Pose::identity(),
        hand_side: HandSide::Left,
        stability: 0.0,
        synergy: SynergyCoordinates::OPEN,
        terms: Vec::new(),
    })
}

fn ask(generator: &mut dyn PoseGenerator) -> Result<Vec<PalmPoseCandidate>, PluginError> {
    let (hand, scene, mut out) = (testing::hand_profile(), PoseScene::ball(), blank());
    let n = generator.generate(&scene.request(&hand, HandSide::Right, GraspType::Tripod), &mut out)?;
    Ok(out[..n].to_vec())
}

#[test]
fn both_forms_of_a_type_answer_the_same_bits() {
    use sfg_plugin::export::ExportPoseGenerator;
    let (hand, params) = (testing::hand_profile(), json!({}));
    let mut built_in = exported_pose::Tower::make(&context(&hand, &params)).unwrap();
    let mut loaded = tower(&params).unwrap();
    let expected = ask(&mut built_in).unwrap();
    assert_eq!(expected.len(), 3);
    assert_eq!(ask(loaded.as_mut()).unwrap(), expected);
    for suite in [testing::pose_generator_suite(&mut built_in, &hand), testing::pose_generator_suite(loaded.as_mut(), &hand)] {
        assert_eq!(suite, Ok(()));
    }
}

/// The messages of two calls to a generator with `fault`.
#[track_caller]
fn check_fault(fault: &str, first: &str, second: &str) {
    let mut generator = tower(&json!({ "fault": fault })).unwrap();
    for expected in [first, second] {
        let message = ask(generator.as_mut()).unwrap_err().to_string();
        assert_eq!(message, format!("plugin \"tower\" failed: {expected}"));
    }
}

#[test]
fn faults_are_errors_and_a_panic_retires_the_instance() {
    let retired = "it is not used any more: it panicked: the tower fell over at call 1";
    check_fault("panic", "it panicked: the tower fell over at call 1", retired);
    let retired = "it is not used any more: it panicked: a panic without a text";
    check_fault("panic_with_a_number", "it panicked: a panic without a text", retired);
    check_fault("fail", "no stone left", "no stone left");
    check_fault("nan", "candidate 0: the stability is not finite", "candidate 0: the stability is not finite");
    let too_many = "it panicked: the generator claims 4 candidates, 3 were asked for";
    check_fault("too_many", too_many, &format!("it is not used any more: {too_many}"));
    let term = "at most 16 terms with names of at most 32 bytes cross the boundary";
    let long = format!("score term {:?}: {term}", "x".repeat(40));
    check_fault("long_term", &long, &long);
}

#[test]
fn a_panic_while_making_or_dropping_stays_inside() {
    let error = tower(&json!({ "fault": "panic_in_make" })).err().unwrap().to_string();
    assert_eq!(error, "plugin \"tower\" failed: it panicked: no ground to build on");
    drop(tower(&json!({ "fault": "panic_in_drop" })).unwrap());
}

#[test]
fn a_bad_parameter_is_the_users_to_mend() {
    let error = tower(&json!({ "height": 3 })).err().unwrap();
    assert!(matches!(&error, HostError::Plugin(PluginError::BadParameter { .. })), "{error:?}");
    assert_eq!(error.to_string(), "plugin \"tower\": unknown parameter \"height\"");
}

#[track_caller]
fn check_refused(path: &Path, is_expected: fn(&HostError) -> bool, words: &str) {
    let error = load_library(path).err().unwrap();
    assert!(is_expected(&error), "{error:?}");
    let message = error.to_string();
    let file = path.file_name().unwrap().to_str().unwrap();
    assert!(message.contains(words) && message.contains(file), "{message}");
}

#[test]
fn what_is_no_plugin_is_refused_with_its_path_and_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("text.so");
    std::fs::write(&text, "not a library").unwrap();
    check_refused(&folder.path().join("absent.so"), |error| matches!(error, HostError::NotFound { .. }), "cannot be opened");
    check_refused(&text, |error| matches!(error, HostError::NotLoadable { .. }), "cannot be loaded");
    check_refused(folder.path(), |error| matches!(error, HostError::NotLoadable { .. }), "cannot be loaded");
    let no_entry = library("no_entry");
    check_refused(&no_entry, |error| matches!(error, HostError::NoEntry { .. }), "no symbol \"sfg_plugin_entry_v1\"");
    let other_version = library("other_version");
    check_refused(&other_version, |error| matches!(error, HostError::OtherVersion { plugin_major: 2, .. }), "speaks version 2");
}
