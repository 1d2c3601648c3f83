//! The part of HELICS that lock-step uses, behind safe functions.
//!
//! In: a library in C (`libhelics`, version 3), loaded at run time. Out: brokers and federates that publish and read vectors of numbers. Every error
//! of the library is returned with the text of the library. All calls of foreign code are in this file.
//!
//! The names and numbers are those of the public header `helics_api.h` of HELICS 3.6.1.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char, c_double, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::peers;

/// The environment variable with the path of the library: the file, or a folder that `pip install --target` has filled.
pub const VARIABLE: &str = "RSM_HELICS";

/// `HELICS_DATA_TYPE_VECTOR`.
const VECTOR: c_int = 4;
/// `HELICS_FLAG_UNINTERRUPTIBLE`: time is granted for the requested time, not earlier because of a new value.
const UNINTERRUPTIBLE: c_int = 1;
/// `HELICS_FLAG_TERMINATE_ON_ERROR`: an error of one federate ends the whole federation.
const TERMINATE_ON_ERROR: c_int = 72;
/// `HELICS_TRUE`.
const TRUE: c_int = 1;

type Handle = *mut c_void;

/// `HelicsError`. Without an error the code is 0 and the text is empty.
#[repr(C)]
struct RawError {
    code: i32,
    message: *const c_char,
}

macro_rules! functions {
    ($($field:ident = $name:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of the library.
        #[derive(Debug)]
        struct Functions { $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)* }

        impl Functions {
            fn find(library: &libloading::Library) -> Result<Self, String> {
                Ok(Functions { $($field: {
                    // SAFETY: the type is that of the function in the public header of version 3, and the library is never closed.
                    let found = unsafe { library.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>($name) };
                    *found.map_err(|error| error.to_string())?
                },)* })
            }
        }
    };
}

functions! {
    version = b"helicsGetVersion\0": fn() -> *const c_char;
    has_core = b"helicsIsCoreTypeAvailable\0": fn(*const c_char) -> c_int;
    create_info = b"helicsCreateFederateInfo\0": fn() -> Handle;
    set_core_type = b"helicsFederateInfoSetCoreTypeFromString\0": fn(Handle, *const c_char, *mut RawError);
    set_core_init = b"helicsFederateInfoSetCoreInitString\0": fn(Handle, *const c_char, *mut RawError);
    set_core_name = b"helicsFederateInfoSetCoreName\0": fn(Handle, *const c_char, *mut RawError);
    set_flag = b"helicsFederateInfoSetFlagOption\0": fn(Handle, c_int, c_int, *mut RawError);
    free_info = b"helicsFederateInfoFree\0": fn(Handle);
    create_federate = b"helicsCreateValueFederate\0": fn(*const c_char, Handle, *mut RawError) -> Handle;
    publication = b"helicsFederateRegisterGlobalPublication\0": fn(Handle, *const c_char, c_int, *const c_char, *mut RawError) -> Handle;
    subscription = b"helicsFederateRegisterSubscription\0": fn(Handle, *const c_char, *const c_char, *mut RawError) -> Handle;
    enter = b"helicsFederateEnterExecutingMode\0": fn(Handle, *mut RawError);
    request_time = b"helicsFederateRequestTime\0": fn(Handle, c_double, *mut RawError) -> c_double;
    publish = b"helicsPublicationPublishVector\0": fn(Handle, *const c_double, c_int, *mut RawError);
    read = b"helicsInputGetVector\0": fn(Handle, *mut c_double, c_int, *mut c_int, *mut RawError);
    global_error = b"helicsFederateGlobalError\0": fn(Handle, c_int, *const c_char, *mut RawError);
    disconnect = b"helicsFederateDisconnect\0": fn(Handle, *mut RawError);
    create_broker = b"helicsCreateBroker\0": fn(*const c_char, *const c_char, *const c_char, *mut RawError) -> Handle;
    wait_for_disconnect = b"helicsBrokerWaitForDisconnect\0": fn(Handle, c_int, *mut RawError) -> c_int;
    broker_is_connected = b"helicsBrokerIsConnected\0": fn(Handle) -> c_int;
    create_query = b"helicsCreateQuery\0": fn(*const c_char, *const c_char) -> Handle;
    query_broker = b"helicsQueryBrokerExecute\0": fn(Handle, Handle, *mut RawError) -> *const c_char;
    free_query = b"helicsQueryFree\0": fn(Handle);
    broker_disconnect = b"helicsBrokerDisconnect\0": fn(Handle, *mut RawError);
}

/// Calls a function that reports an error through its last argument.
macro_rules! checked {
    ($call:expr, $($argument:expr),* $(,)?) => {{
        let mut error = RawError { code: 0, message: ptr::null() };
        // SAFETY: the handles come from this library, which is never closed; pointers to text and numbers are valid until the call returns.
        let result = unsafe { ($call)($($argument,)* &mut error) };
        error.checked(result)
    }};
}

impl RawError {
    fn checked<T>(self, result: T) -> Result<T, String> {
        if self.code == 0 {
            return Ok(result);
        }
        if self.message.is_null() {
            return Err(format!("HELICS error {}", self.code));
        }
        // SAFETY: a text of the library, which is valid until the next call of this thread.
        let message = unsafe { CStr::from_ptr(self.message) };
        Err(message.to_string_lossy().trim().to_string())
    }
}

fn text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).expect("it has no zero left")
}

/// How the processes of a federation communicate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Core {
    /// TCP, every federate to the broker: for several hosts.
    #[default]
    TcpSs,
    /// ZeroMQ.
    Zmq,
    /// Shared memory: for one host.
    Ipc,
}

impl Core {
    /// All transports with their names.
    pub const ALL: [(&'static str, Core); 3] = [("tcp_ss", Core::TcpSs), ("zmq", Core::Zmq), ("ipc", Core::Ipc)];

    /// The name in HELICS.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Core::TcpSs => "tcp_ss",
            Core::Zmq => "zmq",
            Core::Ipc => "ipc",
        }
    }
}

/// The address of the broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// Name or number of the host.
    pub host: String,
    /// The port; `ipc` uses it as the name of its queue.
    pub port: u16,
}

impl Address {
    /// Reads `HOST:PORT`.
    ///
    /// # Errors
    /// A message with what was found and what is expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong = || format!("found `{text}`, expected HOST:PORT, as 192.168.1.10:23500");
        let (host, port) = text.rsplit_once(':').ok_or_else(wrong)?;
        // Both become part of a line of options for HELICS, in which text cannot be quoted.
        let plain = |c: char| c.is_ascii_alphanumeric() || ".-_:[]".contains(c);
        let port = port.parse().ok().filter(|port| *port > 0).ok_or_else(wrong)?;
        if host.is_empty() || host.starts_with('-') || !host.chars().all(plain) {
            return Err(wrong());
        }
        Ok(Address { host: host.to_string(), port })
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

/// The heartbeat. A broker or a federate that has received nothing for two periods sends a request to the others, and ends after two more periods
/// without an answer. So lost peers are noticed after about 2 s. With the library's default of 5 s it would be 20 s.
const HEARTBEAT: &str = "--tick=500ms";

/// The loaded library.
#[derive(Debug)]
pub struct Library {
    functions: Functions,
    /// Its version text.
    pub version: String,
    /// The path from which it was loaded.
    pub place: PathBuf,
}

/// The file names of the library on the operating systems for which it exists.
const FILES: [&str; 3] = ["libhelics.so", "libhelics.dylib", "helics.dll"];

/// Subfolders that may contain the library: the folder itself, those of an installation, those of a package that pip has unpacked.
const FOLDERS: [&str; 6] = ["", "lib64", "lib", "bin", "helics/install/lib64", "helics/install/lib"];

fn candidates(requested: Option<&Path>) -> Vec<PathBuf> {
    match requested {
        Some(folder) if folder.is_dir() => {
            let inside = FOLDERS.iter().flat_map(|below| FILES.iter().map(move |file| folder.join(below).join(file)));
            inside.filter(|file| file.is_file()).collect()
        }
        Some(file) => vec![file.to_path_buf()],
        // The system searches its library path.
        None => FILES.iter().map(PathBuf::from).collect(),
    }
}

/// Whether this process has loaded a library of HELICS.
static LOADED: AtomicBool = AtomicBool::new(false);

impl Library {
    /// Loads the library: `asked` (a file or a folder), otherwise the one in the variable [`VARIABLE`], otherwise the one that the system finds by
    /// its name. It stays loaded until the process ends.
    ///
    /// # Errors
    /// The file is missing or is not this library. The message contains the paths that were tried and how to install the library.
    pub fn load(requested: Option<&Path>) -> Result<&'static Library, String> {
        let from_variable = std::env::var_os(VARIABLE).map(PathBuf::from);
        let requested = requested.or(from_variable.as_deref());
        let mut tried = Vec::new();
        for place in candidates(requested) {
            // SAFETY: the initialisers of libhelics are those of a C++ library. If another library has this name, the user has chosen it.
            match unsafe { libloading::Library::new(&place) } {
                Ok(library) => {
                    LOADED.store(true, Ordering::Release);
                    let library = Box::leak(Box::new(library));
                    return Library::of(library, place);
                }
                Err(error) => tried.push(format!("{}: {error}", place.display())),
            }
        }
        if let Some(requested) = requested.filter(|_| tried.is_empty()) {
            tried.push(format!("{}: no such library in this folder", requested.display()));
        }
        Err(format!(
            "HELICS was not found: {}\n  help: pip install --target helics helics==3.6.1, then {VARIABLE}=$PWD/helics (the folder or the file libhelics.so), or --helics PATH",
            tried.join("; ")
        ))
    }

    fn of(library: &'static libloading::Library, place: PathBuf) -> Result<&'static Library, String> {
        let wrong =
            |what: String| format!("{}: {what}\n  help: HELICS version 3 is required; 3.6.1 was tested", place.display());
        let functions = Functions::find(library).map_err(wrong)?;
        // SAFETY: has no arguments and returns a text that is valid as long as the library is loaded.
        let version = unsafe { CStr::from_ptr((functions.version)()) }.to_string_lossy().into_owned();
        if !version.starts_with("3.") {
            return Err(wrong(format!("it is version {version}")));
        }
        Ok(Box::leak(Box::new(Library { functions, version, place })))
    }

    /// Whether this build of the library supports a transport.
    #[must_use]
    pub fn has(&self, core: Core) -> bool {
        // SAFETY: only reads a text.
        unsafe { (self.functions.has_core)(text(core.name()).as_ptr()) == TRUE }
    }

    /// Starts a broker for this many federates.
    ///
    /// # Errors
    /// The text of the library: the port is in use, or the address does not belong to this host.
    pub fn broker(&'static self, core: Core, address: &Address, federates: usize) -> Result<Broker, String> {
        let (kind, name) = (text(core.name()), text(&queue(address)));
        let place = match core {
            Core::Ipc => format!("--local_interface={}", queue(address)),
            _ => format!("--local_interface={} --port={}", address.host, address.port),
        };
        let options = text(&format!("--federates={federates} {place} {HEARTBEAT} --terminate_on_error --loglevel=no_print"));
        let handle = checked!(self.functions.create_broker, kind.as_ptr(), name.as_ptr(), options.as_ptr())?;
        let broker = Broker { library: self, handle };
        if broker.is_connected() {
            Ok(broker)
        } else {
            Err(format!("the broker cannot listen on {address}: the port is in use, or the address is not of this host"))
        }
    }

    /// Joins a federation. Waits at most the time `wait` for the broker.
    ///
    /// # Errors
    /// The text of the library: there is no broker, or the name is in use.
    pub fn federate(&'static self, name: &str, core: Core, broker: &Address, wait: Duration) -> Result<Federate, String> {
        let functions = &self.functions;
        // SAFETY: has no arguments.
        let info = unsafe { (functions.create_info)() };
        let place = match core {
            Core::Ipc => format!("--broker_address={}", queue(broker)),
            _ => format!("--broker_address={} --brokerport={}", broker.host, broker.port),
        };
        let core_name = peers::core_name(name);
        let wait = wait.as_millis().max(1);
        let options = text(&format!(
            "--federates=1 {place} {HEARTBEAT} --timeout={wait}ms --networktimeout={wait}ms --loglevel=no_print"
        ));
        let made = (|| {
            checked!(functions.set_core_type, info, text(core.name()).as_ptr())?;
            checked!(functions.set_core_init, info, options.as_ptr())?;
            // Without a name the library adds the federate to any core of this process that accepts one, even to a core for a single federate that is
            // about to begin. Then the federation may never begin.
            checked!(functions.set_core_name, info, text(&core_name).as_ptr())?;
            checked!(functions.set_flag, info, UNINTERRUPTIBLE, TRUE)?;
            checked!(functions.set_flag, info, TERMINATE_ON_ERROR, TRUE)?;
            checked!(functions.create_federate, text(name).as_ptr(), info)
        })();
        // SAFETY: created above and not used after this call.
        unsafe { (functions.free_info)(info) };
        made.map(|handle| Federate { library: self, handle })
    }
}

/// The name of a broker, and of its queue in shared memory.
fn queue(address: &Address) -> String {
    format!("rsm-{}", address.port)
}

/// A broker in this process.
#[derive(Debug)]
pub struct Broker {
    library: &'static Library,
    handle: Handle,
}

impl Broker {
    /// Whether it is still running.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        // SAFETY: the handle is that of a broker of this library.
        unsafe { (self.library.functions.broker_is_connected)(self.handle) == TRUE }
    }

    /// Whether all federates have joined; false if the query fails.
    #[must_use]
    pub fn has_begun(&self) -> bool {
        self.answer_to(c"isinit").is_some_and(|answer| answer == "true")
    }

    /// The process numbers of the federates of this program, read from the names of their cores.
    #[must_use]
    pub fn processes(&self) -> Vec<u32> {
        peers::processes(&self.answer_to(c"current_state").unwrap_or_default())
    }

    /// The answer to a query about the broker itself.
    fn answer_to(&self, question: &CStr) -> Option<String> {
        let functions = &self.library.functions;
        // SAFETY: both texts are valid until the call returns; an empty target is the broker itself.
        let query = unsafe { (functions.create_query)(c"".as_ptr(), question.as_ptr()) };
        let answer = checked!(functions.query_broker, query, self.handle).ok().filter(|answer| !answer.is_null());
        // SAFETY: the answer is valid as long as the query.
        let answer = answer.map(|answer| unsafe { CStr::from_ptr(answer) }.to_string_lossy().into_owned());
        // SAFETY: created above and not used after this call.
        unsafe { (functions.free_query)(query) };
        answer
    }

    /// Waits at most this time for the end of the federation. Returns whether it has ended.
    ///
    /// # Errors
    /// The text of the library.
    pub fn ended_within(&self, time: Duration) -> Result<bool, String> {
        let time = c_int::try_from(time.as_millis()).unwrap_or(c_int::MAX);
        Ok(checked!(self.library.functions.wait_for_disconnect, self.handle, time)? == TRUE)
    }

    /// Ends the broker. Federates that are still running get an error.
    pub fn disconnect(&self) {
        let _ = checked!(self.library.functions.broker_disconnect, self.handle);
    }
}

/// A federate in this process. Only one thread at a time uses it.
#[derive(Debug)]
pub struct Federate {
    library: &'static Library,
    handle: Handle,
}

// SAFETY: a federate may be used by any one thread; the library locks the data that threads share.
unsafe impl Send for Federate {}

/// A vector that a federate sends.
#[derive(Debug, Clone, Copy)]
pub struct Publication(Handle);

/// A vector that a federate receives from another federate.
#[derive(Debug, Clone, Copy)]
pub struct Subscription(Handle);

impl Federate {
    /// Registers a vector that this federate sends.
    ///
    /// # Errors
    /// The text of the library: the name is in use.
    pub fn publication(&self, name: &str) -> Result<Publication, String> {
        let functions = &self.library.functions;
        checked!(functions.publication, self.handle, text(name).as_ptr(), VECTOR, c"".as_ptr()).map(Publication)
    }

    /// Registers a vector that this federate receives.
    ///
    /// # Errors
    /// The text of the library.
    pub fn subscription(&self, name: &str) -> Result<Subscription, String> {
        let functions = &self.library.functions;
        checked!(functions.subscription, self.handle, text(name).as_ptr(), c"".as_ptr()).map(Subscription)
    }

    /// Waits until all federates have joined. The simulated time is then 0.
    ///
    /// # Errors
    /// The text of the library: the connection to the broker is lost.
    pub fn enter(&self) -> Result<(), String> {
        checked!(self.library.functions.enter, self.handle)
    }

    /// Waits until the simulated time has reached this time, in s.
    ///
    /// # Errors
    /// The text of the library: a peer or the broker is lost. A granted time other than the requested one is an error too: the federation has ended.
    pub fn request_time(&self, time: f64) -> Result<(), String> {
        let granted = checked!(self.library.functions.request_time, self.handle, time)?;
        // The library counts time in whole nanoseconds.
        if granted < time - 1e-9 || granted > time + 1e-9 {
            return Err(format!("requested the time {time} s, got {granted} s: the federation has ended"));
        }
        Ok(())
    }

    /// Sends a vector at the present time.
    ///
    /// # Errors
    /// The text of the library.
    pub fn publish(&self, to: Publication, values: &[f64]) -> Result<(), String> {
        let length = c_int::try_from(values.len()).map_err(|error| error.to_string())?;
        checked!(self.library.functions.publish, to.0, values.as_ptr(), length)
    }

    /// Reads the vector that was sent last and returns its length. A longer vector is truncated.
    ///
    /// # Errors
    /// The text of the library.
    pub fn read(&self, from: Subscription, values: &mut [f64]) -> Result<usize, String> {
        let capacity = c_int::try_from(values.len()).map_err(|error| error.to_string())?;
        let mut length = 0;
        checked!(self.library.functions.read, from.0, values.as_mut_ptr(), capacity, &mut length)?;
        Ok(usize::try_from(length).unwrap_or(0).min(values.len()))
    }

    /// Ends the federation for all federates, with a message.
    pub fn fail(&self, message: &str) {
        let _ = checked!(self.library.functions.global_error, self.handle, -1, text(message).as_ptr());
    }

    /// Leaves the federation; the others continue.
    pub fn disconnect(&self) {
        let _ = checked!(self.library.functions.disconnect, self.handle);
    }
}

/// Ends the process immediately if a HELICS library was loaded; otherwise does nothing. Write all files before this call.
///
/// At an ordinary end the destructors of the library run while its threads still run. Some runs then end by a signal, even after all their work is
/// done. After an error the destructors may wait for a lost peer (libhelics 3.6.1).
pub fn exit_without_destructors(status: u8) {
    unsafe extern "C" {
        fn _exit(status: c_int) -> !;
    }
    if LOADED.load(Ordering::Acquire) {
        // SAFETY: ends the process; nothing is used after this call.
        unsafe { _exit(c_int::from(status)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_host_and_a_port_and_nothing_else() {
        let address = Address::parse("host-1.lan:23500").unwrap();
        assert_eq!((address.host.as_str(), address.port), ("host-1.lan", 23500));
        assert_eq!(address.to_string(), "host-1.lan:23500");
        for wrong in ["", "host", "host:", ":1", "host:0", "host:70000", "a b:1", "host --profiler=x:1", "-f9:1"] {
            assert!(Address::parse(wrong).unwrap_err().contains("expected HOST:PORT"), "{wrong}");
        }
    }

    #[test]
    fn a_missing_or_wrong_library_is_reported_with_how_to_install_it() {
        let folder = std::env::temp_dir();
        let missing = Library::load(Some(&folder.join("no-such-libhelics.so"))).unwrap_err();
        assert!(
            missing.contains("no-such-libhelics.so") && missing.contains("pip install") && missing.contains(VARIABLE),
            "{missing}"
        );
        let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let empty = Library::load(Some(&own)).unwrap_err();
        assert!(empty.contains("no such library in this folder"), "{empty}");
        let no_library = Library::load(Some(&own.join("lib.rs"))).unwrap_err();
        assert!(no_library.contains("lib.rs") && no_library.contains("pip install"), "{no_library}");
    }
}
