//! Notifications to the service manager that started the daemon: ready, stopping, alive. One datagram per message, as
//! in sd_notify(3). Without a service manager nothing is sent.

use std::ffi::OsStr;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Longest time that sending a message may block.
const LONGEST_WAIT: Duration = Duration::from_secs(1);

/// The service manager's variables in the environment; read by the command line.
#[derive(Clone, Copy, Debug, Default)]
pub struct NotifyEnv<'a> {
    /// `NOTIFY_SOCKET`: address it listens on.
    pub socket: Option<&'a OsStr>,
    /// `WATCHDOG_USEC`: longest time between two signs of life, µs.
    pub watchdog_usec: Option<&'a str>,
    /// `WATCHDOG_PID`: the process that must send them.
    pub watchdog_pid: Option<&'a str>,
}

/// The service manager; without an address, messages are dropped.
#[derive(Clone, Debug, Default)]
pub struct ServiceManager {
    address: Option<SocketAddr>,
    watchdog_interval: Option<Duration>,
}

impl ServiceManager {
    /// The service manager that `notice` describes, for the process `pid`.
    pub fn new(notice: NotifyEnv<'_>, pid: u32) -> Result<Self, String> {
        let address = notice.socket.map(address_of).transpose()?;
        let is_meant = notice.watchdog_pid.is_none_or(|meant| meant == pid.to_string());
        let watchdog_interval =
            notice.watchdog_usec.filter(|_| is_meant && address.is_some()).map(interval_from_usec).transpose()?;
        Ok(Self { address, watchdog_interval })
    }

    /// Reports that the daemon answers requests. `status` is shown as the service's status.
    pub fn ready(&self, status: &str) {
        self.notify(&format!("READY=1\nSTATUS={}", one_line(status)));
    }

    /// Reports that the daemon is shutting down.
    pub fn stopping(&self) {
        self.notify("STOPPING=1\nSTATUS=ending");
    }

    /// Starts a thread that sends signs of life, twice in the manager's watchdog interval and only while `well` returns
    /// `Ok`. `None` where the manager expects none.
    pub fn keep_alive(
        &self,
        healthy: impl Fn() -> Result<(), String> + Send + 'static,
    ) -> io::Result<Option<WatchdogPing>> {
        let Some(watchdog_interval) = self.watchdog_interval else { return Ok(None) };
        let (ending, manager) = (Arc::new(AtomicBool::new(false)), self.clone());
        let has_ended = Arc::clone(&ending);
        let show = move || manager.start_watchdog_ping(watchdog_interval / 2, &has_ended, &healthy);
        let thread = thread::Builder::new().name("alive".into()).spawn(show)?;
        Ok(Some(WatchdogPing { ending, thread: Some(thread) }))
    }

    fn start_watchdog_ping(&self, period: Duration, ending: &AtomicBool, healthy: &dyn Fn() -> Result<(), String>) {
        let mut before = Ok(());
        while !ending.load(Ordering::SeqCst) {
            let now = healthy();
            if now.is_ok() {
                self.notify("WATCHDOG=1");
            }
            if now != before {
                self.notify(&format!(
                    "STATUS={}",
                    one_line(now.as_ref().err().map_or("healthy again", String::as_str))
                ));
                match &now {
                    Ok(()) => tracing::info!("healthy again"),
                    Err(why) => tracing::error!("no sign of life for the service manager: {why}"),
                }
            }
            before = now;
            thread::park_timeout(period);
        }
    }

    /// Sends a message. A failure is only logged: a service manager that does not listen must not stop the daemon.
    fn notify(&self, message: &str) {
        let Some(address) = &self.address else { return };
        if let Err(error) = send(address, message) {
            tracing::warn!(%error, "could not notify the service manager");
        }
    }
}

/// The thread that sends signs of life; dropping it ends them.
#[derive(Debug)]
pub struct WatchdogPing {
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for WatchdogPing {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // not joined: its check may hang
        }
    }
}

fn send(address: &SocketAddr, message: &str) -> io::Result<()> {
    let socket = UnixDatagram::unbound()?;
    socket.set_write_timeout(Some(LONGEST_WAIT))?;
    socket.send_to_addr(message.as_bytes(), address).map(|_| ())
}

/// The address of a path, or of `@` and an abstract name.
fn address_of(socket: &OsStr) -> Result<SocketAddr, String> {
    let bad = |why: &dyn std::fmt::Display| format!("NOTIFY_SOCKET: {why}, found {}", socket.display());
    match socket.as_bytes() {
        [b'@', name @ ..] => abstract_address(name).map_err(|error| bad(&error)),
        [b'/', ..] => SocketAddr::from_pathname(socket).map_err(|error| bad(&error)),
        _ => Err(bad(&"expected a path, or @ and a name")),
    }
}

#[cfg(target_os = "linux")]
fn abstract_address(name: &[u8]) -> io::Result<SocketAddr> {
    use std::os::linux::net::SocketAddrExt;
    SocketAddr::from_abstract_name(name)
}

#[cfg(not(target_os = "linux"))]
fn abstract_address(_: &[u8]) -> io::Result<SocketAddr> {
    Err(io::ErrorKind::Unsupported.into())
}

fn interval_from_usec(usec: &str) -> Result<Duration, String> {
    let usec_of = |text: &str| text.parse().ok().filter(|usec| *usec > 0).map(Duration::from_micros);
    usec_of(usec).ok_or_else(|| format!("WATCHDOG_USEC: expected a number of microseconds above 0, found {usec}"))
}

/// The text on one line: a line feed would begin another message.
fn one_line(text: &str) -> String {
    text.replace(char::is_control, " ")
}

#[cfg(test)]
mod tests {
    use std::ffi::OsString;

    use super::*;

    struct Stub {
        socket: UnixDatagram,
        name: OsString,
        _folder: tempfile::TempDir,
    }

    impl Stub {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("notify");
            let socket = UnixDatagram::bind(&path).unwrap();
            socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
            Self { socket, name: path.into(), _folder: folder }
        }

        fn manager(&self, watchdog_usec: Option<&str>) -> ServiceManager {
            ServiceManager::new(NotifyEnv { socket: Some(&self.name), watchdog_usec, watchdog_pid: None }, 7).unwrap()
        }

        fn heard(&self) -> String {
            heard(&self.socket)
        }
    }

    fn heard(socket: &UnixDatagram) -> String {
        let mut bytes = [0; 512];
        let length = socket.recv(&mut bytes).unwrap();
        String::from_utf8(bytes[..length].to_vec()).unwrap()
    }

    #[test]
    fn each_message_is_one_datagram() {
        let stub = Stub::new();
        let manager = stub.manager(None);
        manager.ready("3 plates\nWATCHDOG=1");
        manager.stopping();
        assert_eq!(stub.heard(), "READY=1\nSTATUS=3 plates WATCHDOG=1");
        assert_eq!(stub.heard(), "STOPPING=1\nSTATUS=ending");
        assert!(manager.keep_alive(|| Ok(())).unwrap().is_none(), "nobody waits for a sign of life");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn abstract_socket_name_is_reached() {
        use std::os::linux::net::SocketAddrExt;
        let name = format!("upm-test-{}", std::process::id());
        let socket = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let named = OsString::from(format!("@{name}"));
        ServiceManager::new(NotifyEnv { socket: Some(&named), ..NotifyEnv::default() }, 7).unwrap().stopping();
        assert!(heard(&socket).starts_with("STOPPING=1"));
    }

    #[test]
    fn watchdog_pings_are_sent_only_while_healthy() {
        let stub = Stub::new();
        let healthy = Arc::new(AtomicBool::new(true));
        let asked = Arc::clone(&healthy);
        let state = move || if asked.load(Ordering::SeqCst) { Ok(()) } else { Err("a plate hangs".to_owned()) };
        let alive = stub.manager(Some("20000")).keep_alive(state).unwrap().unwrap();
        assert_eq!([stub.heard(), stub.heard()], ["WATCHDOG=1", "WATCHDOG=1"]);
        healthy.store(false, Ordering::SeqCst);
        while stub.heard() == "WATCHDOG=1" {}
        stub.socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        assert!(stub.socket.recv(&mut [0; 64]).is_err(), "ten periods without a word");
        stub.socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        healthy.store(true, Ordering::SeqCst);
        assert_eq!([stub.heard(), stub.heard()], ["WATCHDOG=1", "STATUS=healthy again"]);
        drop(alive);
        stub.socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        while stub.socket.recv(&mut [0; 64]).is_ok() {}
    }

    #[test]
    fn without_a_service_manager_nothing_happens() {
        let manager =
            ServiceManager::new(NotifyEnv { watchdog_usec: Some("1000000"), ..NotifyEnv::default() }, 7).unwrap();
        manager.ready("");
        assert!(manager.keep_alive(|| Ok(())).unwrap().is_none());
        let gone = OsStr::new("/nonexistent/notify");
        ServiceManager::new(NotifyEnv { socket: Some(gone), ..NotifyEnv::default() }, 7).unwrap().stopping();
    }

    #[test]
    fn only_the_addressed_process_pings_and_bad_settings_are_reported() {
        let socket = Some(OsStr::new("/run/notify"));
        let made =
            |watchdog_usec, watchdog_pid| ServiceManager::new(NotifyEnv { socket, watchdog_usec, watchdog_pid }, 7);
        assert_eq!(made(Some("3000000"), Some("7")).unwrap().watchdog_interval, Some(Duration::from_secs(3)));
        assert_eq!(made(Some("3000000"), Some("8")).unwrap().watchdog_interval, None);
        for bad in ["", "0", "-1", "x"] {
            assert!(made(Some(bad), None).unwrap_err().starts_with("WATCHDOG_USEC: expected "), "{bad}");
        }
        let odd = NotifyEnv { socket: Some(OsStr::new("notify")), ..NotifyEnv::default() };
        assert!(ServiceManager::new(odd, 7).unwrap_err().ends_with(", found notify"));
    }
}
