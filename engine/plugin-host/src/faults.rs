//! Tests of tables that break the rules of the boundary, without a library.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
#![allow(unsafe_code, reason = "the other side of the boundary is played here")]

use crate::library::initialise;
use crate::{DynamicPoseGenerator, HostError, LoadedPlugin, PoseGeneratorFactory};
use serde_json::json;
use sfg_plugin::testing::{self, PoseScene};
use sfg_plugin::{PluginContext, PluginError, PoseGenerator, abi};
use sfg_types::{GraspType, HandSide, PalmPoseCandidate, Pose, SynergyCoordinates};
use std::ffi::c_void;
use std::path::{Path, PathBuf};
use std::ptr;

type Generate = unsafe extern "C" fn(
    *mut abi::Instance,
    *const abi::PoseRequest,
    *mut abi::PalmPose,
    usize,
    *mut usize,
    *mut abi::ErrorBuffer,
) -> abi::RawStatus;

unsafe extern "C" fn create(
    _: *const abi::PoseGeneratorConfig,
    instance: *mut *mut abi::Instance,
    _: *mut abi::ErrorBuffer,
) -> abi::RawStatus {
    // SAFETY: `instance` is writable.
    unsafe { instance.write(ptr::dangling_mut()) };
    abi::status::OK
}

unsafe extern "C" fn create_nothing(
    _: *const abi::PoseGeneratorConfig,
    _: *mut *mut abi::Instance,
    _: *mut abi::ErrorBuffer,
) -> abi::RawStatus {
    abi::status::OK
}

unsafe extern "C" fn destroy(_: *mut abi::Instance) {}

unsafe extern "C" fn destroy_never(_: *mut abi::Instance) {
    // Unwinding out of here aborts the test.
    panic!("a retired instance was destroyed");
}

/// A `generate` that claims `$written` candidates and returns `$status`; it writes an ordinary pose, or one that was changed.
macro_rules! generate {
    ($status:expr, $written:expr) => {
        generate!($status, $written, |pose| pose.stability = 0.5)
    };
    ($status:expr, $written:expr, |$pose:ident| $change:expr) => {{
        unsafe extern "C" fn generate(
            _: *mut abi::Instance,
            _: *const abi::PoseRequest,
            out: *mut abi::PalmPose,
            _: usize,
            written: *mut usize,
            _: *mut abi::ErrorBuffer,
        ) -> abi::RawStatus {
            let mut $pose = abi::PalmPose::UNSET;
            $change;
            // SAFETY: the tests lend room for two candidates.
            unsafe {
                out.write($pose);
                written.write($written);
            }
            $status
        }
        generate
    }};
}

fn table(generate: Generate) -> abi::PoseGeneratorTable {
    abi::PoseGeneratorTable {
        struct_size: abi::struct_size::<abi::PoseGeneratorTable>(),
        reserved: 0,
        name: abi::Text::new("fake"),
        create: Some(create),
        destroy: Some(destroy),
        generate: Some(generate),
    }
}

/// The checked form of `table`; it copies what it needs.
fn factory(table: &abi::PoseGeneratorTable) -> Result<PoseGeneratorFactory, String> {
    // SAFETY: the functions above keep the promises that the test at hand does not break on purpose.
    unsafe { PoseGeneratorFactory::new(table, None) }
}

fn make(table: &abi::PoseGeneratorTable) -> Result<DynamicPoseGenerator, PluginError> {
    let (hand, params) = (testing::hand_profile(), json!({}));
    let context =
        PluginContext { params: &params, scenarios_dir: Path::new("."), hand: &hand, hand_side: HandSide::Left, seed: 1 };
    DynamicPoseGenerator::new(&factory(table).unwrap(), &context)
}

fn ask(generator: &mut DynamicPoseGenerator) -> Result<usize, String> {
    let (hand, scene) = (testing::hand_profile(), PoseScene::unobserved());
    let mut out = [(); 2].map(|()| PalmPoseCandidate {
        base_from_palm: Pose::identity(),
        hand_side: HandSide::Left,
        stability: 0.0,
        synergy: SynergyCoordinates::OPEN,
        terms: Vec::new(),
    });
    let answer = generator.generate(&scene.request(&hand, HandSide::Left, GraspType::Tripod), &mut out);
    answer.map_err(|error| error.to_string())
}

#[track_caller]
fn check(generate: Generate, expected: &str, retires: bool) {
    let mut table = table(generate);
    if retires {
        table.destroy = Some(destroy_never);
    }
    let mut generator = make(&table).unwrap();
    let first = ask(&mut generator).unwrap_err();
    assert_eq!(first, format!("plugin \"fake\" failed: {expected}"));
    let second = ask(&mut generator).unwrap_err();
    assert_eq!(second.contains("it is not used any more"), retires, "{second}");
}

#[test]
fn values_of_a_plugin_are_checked() {
    assert_eq!(ask(&mut make(&table(generate!(abi::status::OK, 2))).unwrap()), Ok(2));
    check(generate!(abi::status::OK, 1, |pose| pose.stability = f64::NAN), "candidate 0: the stability is not finite", false);
    check(
        generate!(abi::status::OK, 1, |pose| pose.base_from_palm.rotation_wxyz = [0.0; 4]),
        "candidate 0: the quaternion of the palm pose has norm 0.000000, not 1",
        false,
    );
    check(generate!(abi::status::OK, 1, |pose| pose.n_terms = 99), "candidate 0: number of score terms 99 is unknown", false);
    check(generate!(abi::status::FAILED, 0), "it gives no reason", false);
}

#[test]
fn an_instance_that_breaks_the_rules_is_retired_and_never_destroyed() {
    check(generate!(99, 0), "it returned the unknown status 99", true);
    check(generate!(-1, 0), "it returned the unknown status -1", true);
    check(generate!(abi::status::OK, 3), "it claims 3 candidates, there was room for 2", true);
    check(generate!(abi::status::PANICKED, 0), "it panicked: it gives no reason", true);
}

#[test]
fn a_table_is_checked_before_it_is_used() {
    let good = table(generate!(abi::status::OK, 0));
    let spoilt = |spoil: fn(&mut abi::PoseGeneratorTable)| {
        let mut table = good;
        spoil(&mut table);
        factory(&table).map(|factory| factory.name().to_owned())
    };
    assert_eq!(spoilt(|_| ()), Ok("fake".to_owned()));
    assert_eq!(spoilt(|table| table.generate = None), Err("the function `generate` is null".to_owned()));
    assert_eq!(spoilt(|table| table.create = None), Err("the function `create` is null".to_owned()));
    let short = "the pose generator table has 40 bytes, at least 48 are needed";
    assert_eq!(spoilt(|table| table.struct_size = 40), Err(short.to_owned()));
    assert!(spoilt(|table| table.name = abi::Text::new("Fake Name")).unwrap_err().contains("\"Fake Name\""));
    assert!(spoilt(|table| table.name = abi::Text { pointer: ptr::null(), length: 4 }).unwrap_err().contains("not UTF-8"));
    // A newer library's longer table is fine.
    assert!(spoilt(|table| table.struct_size = 480).is_ok());
    let mut nothing = good;
    nothing.create = Some(create_nothing);
    assert!(make(&nothing).unwrap_err().to_string().contains("made no instance"));
}

unsafe extern "C" fn init(_: *const abi::Host, _: *mut abi::ErrorBuffer) -> abi::RawStatus {
    abi::status::OK
}

unsafe extern "C" fn init_that_fails(host: *const abi::Host, error: *mut abi::ErrorBuffer) -> abi::RawStatus {
    // SAFETY: both are lent until return.
    unsafe {
        let path = (*host).library_path.as_str().unwrap_or_default();
        (*error).write(&format!("no licence for {path}"));
    }
    abi::status::FAILED
}

unsafe extern "C" fn deinit() {}

unsafe extern "C" fn offers_nothing(_: abi::Text) -> *const c_void {
    ptr::null()
}

#[track_caller]
fn start(entry: &abi::Entry) -> Result<LoadedPlugin, HostError> {
    // SAFETY: the entry outlives the call, and nothing of it is kept but its functions.
    unsafe { initialise(PathBuf::from("fake.so"), &raw const entry.head) }
}

#[test]
fn an_entry_is_checked_before_it_is_used() {
    let good = abi::Entry::new(init, deinit, offers_nothing);
    let plugin = start(&good).unwrap();
    assert!(plugin.pose_generator().unwrap().is_none());
    let refused = crate::Registry::new().add_library(&plugin).unwrap_err();
    assert!(refused.to_string().contains("offers nothing this program knows"), "{refused}");

    let mut entry = good;
    entry.head.abi_major += 1;
    assert!(matches!(start(&entry), Err(HostError::OtherVersion { plugin_major: 2, .. })));
    entry = good;
    entry.head.struct_size = 24;
    assert!(matches!(start(&entry), Err(HostError::Broken { .. })));
    entry = good;
    entry.get_factory = None;
    assert!(matches!(start(&entry), Err(HostError::Broken { .. })));
    entry = good;
    entry.init = Some(init_that_fails);
    let message = start(&entry).unwrap_err().to_string();
    assert_eq!(message, "plugin library \"fake.so\" could not start: no licence for fake.so (status 2)");
}
