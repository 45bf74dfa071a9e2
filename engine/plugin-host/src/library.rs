//! Opening a library and checking it before anything of it is used.

#![expect(unsafe_code, reason = "the host's side of the C boundary")]

use crate::HostError;
use sfg_plugin::{abi, views};
use std::ffi::c_void;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Room for an error message of a plugin, bytes.
const MESSAGE_BYTES: usize = 1024;

/// A library that was loaded, checked and initialised. Copies share it; it stays mapped until the process ends.
#[derive(Clone, Debug)]
pub struct LoadedPlugin(Arc<Inner>);

/// A library's generator of palm poses, not made yet.
#[derive(Clone, Debug)]
pub struct PoseGeneratorFactory {
    pub(crate) table: PoseGeneratorFunctions,
    name: String,
    /// `deinit` waits until the last instance is gone.
    _plugin: Option<LoadedPlugin>,
}

/// The functions of a table, known not to be null.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PoseGeneratorFunctions {
    pub(crate) create:
        unsafe extern "C" fn(*const abi::PoseGeneratorConfig, *mut *mut abi::Instance, *mut abi::ErrorBuffer) -> abi::RawStatus,
    pub(crate) destroy: unsafe extern "C" fn(*mut abi::Instance),
    pub(crate) generate: unsafe extern "C" fn(
        *mut abi::Instance,
        *const abi::PoseRequest,
        *mut abi::PalmPose,
        usize,
        *mut usize,
        *mut abi::ErrorBuffer,
    ) -> abi::RawStatus,
}

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    get_factory: unsafe extern "C" fn(abi::Text) -> *const c_void,
    deinit: unsafe extern "C" fn(),
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: obligation 1 of `Entry::deinit`: `init` succeeded once for this value, and every instance holds a copy of it.
        unsafe { (self.deinit)() };
    }
}

/// Loads the library at `path`, checks its version and initialises it.
///
/// All symbols are resolved now, so that a missing one is found here, and none is shown to other libraries. The library is never
/// unloaded: unloading Rust code is unsound in general (rust-lang/rust#59629).
///
/// # Errors
/// [`HostError`] with the path and the reason: not there, not loadable, no plugin, another version, broken, `init` failed.
pub fn load_library(path: &Path) -> Result<LoadedPlugin, HostError> {
    // An absolute path: the loader looks a bare name up in the system's folders.
    let path = path.canonicalize().map_err(|source| HostError::NotFound { path: path.to_owned(), source })?;
    let library = ManuallyDrop::new(open(&path)?);
    // SAFETY: the symbol of this name is a static `Entry`, of which at most the head is read before the version is known.
    // That a library keeps to this cannot be checked: the name of the symbol is the promise.
    let head = match unsafe { library.get::<*const abi::EntryHead>(abi::ENTRY_SYMBOL.as_bytes()) } {
        Ok(symbol) => *symbol,
        Err(_no_symbol) => return Err(HostError::NoEntry { path }),
    };
    // SAFETY: the symbol points to a static of this library, which is never unloaded.
    unsafe { initialise(path, head) }
}

impl LoadedPlugin {
    /// Where the library lies, absolute.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Whether the library has a table for capability `id`.
    #[must_use]
    pub fn offers(&self, id: &str) -> bool {
        !self.factory(id).is_null()
    }

    /// The library's generator of palm poses, if it has one.
    ///
    /// # Errors
    /// [`HostError::Broken`] when the table is too short, has a null function, or a name that no scenario can write.
    pub fn pose_generator(&self) -> Result<Option<PoseGeneratorFactory>, HostError> {
        let table = self.factory(abi::capability::POSE_GENERATOR).cast::<abi::PoseGeneratorTable>();
        if table.is_null() {
            return Ok(None);
        }
        // SAFETY: a table asked for by this id has this type and lives as long as the process (`Entry::get_factory`).
        let factory = unsafe { PoseGeneratorFactory::new(table, Some(self.clone())) };
        factory.map(Some).map_err(|reason| HostError::Broken { path: self.0.path.clone(), reason })
    }

    fn factory(&self, id: &str) -> *const c_void {
        // SAFETY: obligation 1 of `Entry::get_factory`: the id is borrowed until return.
        unsafe { (self.0.get_factory)(abi::Text::new(id)) }
    }
}

impl PoseGeneratorFactory {
    /// The name a scenario asks for.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The checked form of `table`, or what is wrong with it.
    ///
    /// # Safety
    /// 1. `table` is null or points to a table that keeps the promises of [`abi::PoseGeneratorTable`] as long as the process lives.
    pub(crate) unsafe fn new(table: *const abi::PoseGeneratorTable, plugin: Option<LoadedPlugin>) -> Result<Self, String> {
        // SAFETY: obligation 1.
        let (table, name) = unsafe {
            let table = views::read_sized(table, "the pose generator table").map_err(|error| error.to_string())?;
            (table, views::text(table.name, "the plugin's name").map_err(|error| error.to_string())?)
        };
        if name.is_empty() || !name.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_')) {
            return Err(format!("its name {name:?} is not made of lower-case letters, digits, '-' and '_'"));
        }
        let functions = PoseGeneratorFunctions {
            create: table.create.ok_or("the function `create` is null")?,
            destroy: table.destroy.ok_or("the function `destroy` is null")?,
            generate: table.generate.ok_or("the function `generate` is null")?,
        };
        Ok(Self { table: functions, name, _plugin: plugin })
    }
}

/// Runs `call` with a buffer for its message; the message of the callee follows the status.
pub(crate) fn with_message(call: impl FnOnce(*mut abi::ErrorBuffer) -> abi::RawStatus) -> (abi::RawStatus, String) {
    let mut room = [0; MESSAGE_BYTES];
    let mut buffer = abi::ErrorBuffer::new(&mut room);
    let status = call(&raw mut buffer);
    let length = buffer.length.min(MESSAGE_BYTES);
    let message = String::from_utf8_lossy(&room[..length]).into_owned();
    (status, if message.is_empty() { "it gives no reason".to_owned() } else { message })
}

/// Checks the entry behind `head` and calls its `init`.
///
/// # Safety
/// 1. `head` is null or points to the head of a static [`abi::Entry`] that lives as long as the process.
pub(crate) unsafe fn initialise(path: PathBuf, head: *const abi::EntryHead) -> Result<LoadedPlugin, HostError> {
    if head.is_null() {
        return Err(HostError::NoEntry { path });
    }
    // SAFETY: obligation 1.
    let &abi::EntryHead { struct_size, abi_major, .. } = unsafe { &*head };
    if abi_major != abi::ABI_MAJOR {
        return Err(HostError::OtherVersion { path, plugin_major: abi_major });
    }
    let expected = abi::struct_size::<abi::Entry>();
    if struct_size < expected {
        let reason = format!("its entry has {struct_size} bytes, at least {expected} are needed");
        return Err(HostError::Broken { path, reason });
    }
    // SAFETY: obligation 1; the version is ours and the size covers the struct.
    let entry = unsafe { head.cast::<abi::Entry>().read() };
    let (Some(init), Some(deinit), Some(get_factory)) = (entry.init, entry.deinit, entry.get_factory) else {
        return Err(HostError::Broken { path, reason: "a function of its entry is null".to_owned() });
    };
    let text = path.to_string_lossy().into_owned();
    let host = abi::Host {
        struct_size: abi::struct_size::<abi::Host>(),
        abi_major: abi::ABI_MAJOR,
        abi_minor: abi::ABI_MINOR,
        library_path: abi::Text::new(&text),
    };
    // SAFETY: obligation 1 of `Entry::init`: both live until return.
    let (status, message) = with_message(|error| unsafe { init(&raw const host, error) });
    if status != abi::status::OK {
        return Err(HostError::InitFailed { path, reason: format!("{message} (status {status})") });
    }
    Ok(LoadedPlugin(Arc::new(Inner { path, get_factory, deinit })))
}

fn open(path: &Path) -> Result<libloading::Library, HostError> {
    #[cfg(unix)]
    // SAFETY: the initialisers of the library run here and could do anything. They are trusted: the user put this file on the
    // search path to have its code run. Its finalisers never run, because it is never closed.
    let opened = unsafe {
        use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};
        Library::open(Some(path), RTLD_NOW | RTLD_LOCAL).map(libloading::Library::from)
    };
    #[cfg(not(unix))]
    // SAFETY: as above.
    let opened = unsafe { libloading::Library::new(path) };
    opened.map_err(|error| {
        let reason = match std::error::Error::source(&error) {
            Some(source) => source.to_string(),
            None => error.to_string(),
        };
        let hint = if reason.contains("static TLS") {
            "; it needs more thread-local storage than is left for loaded libraries: build it without the initial-exec model"
        } else {
            ""
        };
        HostError::NotLoadable { path: path.to_owned(), reason, hint }
    })
}
