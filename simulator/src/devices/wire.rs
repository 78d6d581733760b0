//! The other end of a driver's link: a TCP port or a pseudo-terminal, and what can go wrong on it.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A device's side of a conversation.
pub trait Protocol: Send {
    /// What it says when somebody connects, or when it is switched on.
    fn connected(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Takes in bytes and returns the answers, each by itself.
    fn receive(&mut self, bytes: &[u8]) -> Vec<Vec<u8>>;

    /// What it says by itself, and answers that took their time. Called every few milliseconds.
    fn tick(&mut self) -> Vec<u8> {
        Vec::new()
    }
}

/// What becomes of one answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireFault {
    /// It never arrives.
    Silence,
    /// Something else arrives.
    Garbage,
    /// Its first half arrives.
    Truncated,
    /// The connection is lost instead; it can be opened again.
    Disconnect,
}

/// How long the threads wait before they look around.
const TICK: Duration = Duration::from_millis(3);

/// A silence after which somebody else may have the line.
const PATIENT: Duration = Duration::from_millis(200);

/// A device that is connected. It goes when this is dropped.
pub struct Wire {
    address: String,
    faults: Arc<Mutex<VecDeque<WireFault>>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Wire {
    /// Serves `protocol` at a TCP port of this machine; 0 takes a free one.
    ///
    /// # Errors
    /// The port is taken.
    pub fn tcp(port: u16, protocol: impl Protocol + 'static) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?.port().to_string();
        Ok(Self::start(address, move |state| serve_tcp(&listener, protocol, state)))
    }

    /// Serves `protocol` at a pseudo-terminal, which looks to a driver like a serial port.
    ///
    /// # Errors
    /// The system has no pseudo-terminal left, or no room for a link to it.
    #[cfg(unix)]
    pub fn serial(protocol: impl Protocol + 'static) -> io::Result<Self> {
        let folder = tempfile::tempdir()?;
        // A link of a name that stays, as those of /dev/serial/by-id are.
        let path = folder.path().join("port");
        let address = path.to_string_lossy().into_owned();
        let pair = open_pair(&path)?;
        Ok(Self::start(address, move |state| {
            serve_serial(pair, &path, protocol, state);
            drop(folder);
        }))
    }

    fn start(address: String, serve: impl FnOnce(&State) + Send + 'static) -> Self {
        let faults = Arc::default();
        let stop = Arc::new(AtomicBool::new(false));
        let state = State { faults: Arc::clone(&faults), stop: Arc::clone(&stop) };
        let thread = Some(std::thread::spawn(move || serve(&state)));
        Self { address, faults, stop, thread }
    }

    /// The number of the TCP port, or the path of the serial port.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// The number of the TCP port; `None` on a serial port.
    pub fn port(&self) -> Option<u16> {
        self.address.parse().ok()
    }

    /// Lets `fault` happen to the next answer, or the one after those that wait already.
    pub fn inject(&self, fault: WireFault) {
        self.faults.lock().unwrap_or_else(PoisonError::into_inner).push_back(fault);
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic over there has been printed over there.
            let _ = thread.join();
        }
    }
}

struct State {
    faults: Arc<Mutex<VecDeque<WireFault>>>,
    stop: Arc<AtomicBool>,
}

impl State {
    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Sends the answers as far as the faults allow. False if the connection is to be lost.
    fn send(&self, answers: Vec<Vec<u8>>, to: &mut dyn Write) -> bool {
        for answer in answers.into_iter().filter(|a| !a.is_empty()) {
            let fault = self.faults.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
            let sent = match fault {
                None => to.write_all(&answer),
                Some(WireFault::Silence) => Ok(()),
                // Never part of any protocol here, and long enough to swallow any terminator.
                Some(WireFault::Garbage) => to.write_all(b"\x00\xff\xfe#?;\x80\r\n"),
                Some(WireFault::Truncated) => {
                    to.write_all(answer.get(..answer.len() / 2).unwrap_or_default())
                }
                Some(WireFault::Disconnect) => return false,
            };
            if sent.is_err() {
                return false;
            }
        }
        true
    }
}

fn serve_tcp(listener: &TcpListener, mut protocol: impl Protocol, state: &State) {
    while !state.stopped() {
        match listener.accept() {
            Ok((stream, _)) => {
                // Whatever ends a conversation, the next one may begin; the one that ended it by
                // knocking comes first.
                let mut next = Some(stream);
                while let Some(stream) = next.take() {
                    next = talk(stream, listener, &mut protocol, state).unwrap_or_default();
                }
            }
            Err(_) => {
                std::thread::sleep(TICK);
                protocol.tick();
            }
        }
    }
}

/// Talks until one side hangs up, or until somebody else knocks after a silence: projectors talk
/// to one at a time, and are left hanging by some programs. Returns that somebody.
fn talk(
    mut stream: TcpStream,
    listener: &TcpListener,
    protocol: &mut impl Protocol,
    state: &State,
) -> io::Result<Option<TcpStream>> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(TICK))?;
    let greeting = protocol.connected();
    let mut next = None;
    converse(&mut stream, greeting, protocol, state, |quiet| {
        if quiet > PATIENT {
            next = listener.accept().ok().map(|(stream, _)| stream);
        }
        next.is_none()
    });
    Ok(next)
}

/// Until the other side hangs up, a fault says so, `go_on` does after so much silence, or the wire
/// is dropped.
fn converse(
    stream: &mut (impl Read + Write),
    greeting: Vec<u8>,
    protocol: &mut impl Protocol,
    state: &State,
    mut go_on: impl FnMut(Duration) -> bool,
) {
    let mut heard = Instant::now();
    let mut buffer = [0; 512];
    if !state.send(vec![greeting], stream) {
        return;
    }
    while !state.stopped() {
        let answers = match stream.read(&mut buffer) {
            Ok(0) => return,
            Ok(n) => {
                heard = Instant::now();
                protocol.receive(buffer.get(..n).unwrap_or_default())
            }
            Err(error) if quiet(&error) && go_on(heard.elapsed()) => vec![protocol.tick()],
            Err(_) => return,
        };
        if !state.send(answers, stream) {
            return;
        }
    }
}

fn quiet(error: &io::Error) -> bool {
    use io::ErrorKind as K;
    matches!(error.kind(), K::TimedOut | K::WouldBlock | K::Interrupted)
}

#[cfg(unix)]
type Pair = (serialport::TTYPort, serialport::TTYPort);

/// A new pseudo-terminal, and `path` a link to it.
#[cfg(unix)]
fn open_pair(path: &std::path::Path) -> io::Result<Pair> {
    use serialport::SerialPort;
    let (mut device, computer) = serialport::TTYPort::pair()?;
    device.set_timeout(TICK)?;
    let name = computer.name().ok_or(io::ErrorKind::NotFound)?;
    let fresh = path.with_extension("new");
    std::os::unix::fs::symlink(name, &fresh)?;
    std::fs::rename(&fresh, path)?;
    // The computer's side stays open here: without it reading fails while nobody is there.
    Ok((device, computer))
}

#[cfg(unix)]
fn serve_serial(pair: Pair, path: &std::path::Path, mut protocol: impl Protocol, state: &State) {
    let mut pair = Some(pair);
    while let Some((mut device, computer)) = pair.take() {
        let greeting = protocol.connected();
        converse(&mut device, greeting, &mut protocol, state, |_| true);
        if state.stopped() {
            return;
        }
        // The link first: the number of a closed pseudo-terminal may be another's a moment later.
        // If it cannot be removed it is replaced below.
        let _ = std::fs::remove_file(path);
        drop((device, computer));
        pair = open_pair(path).ok();
    }
}

/// The lines that `bytes` complete, without their ends; what is left waits in `rest`.
pub(super) fn lines(rest: &mut Vec<u8>, bytes: &[u8], ends: &[u8]) -> Vec<Vec<u8>> {
    rest.extend(bytes);
    let mut lines = Vec::new();
    while let Some(at) = rest.iter().position(|b| ends.contains(b)) {
        let mut line: Vec<u8> = rest.drain(..=at).collect();
        line.pop();
        lines.push(line);
    }
    lines
}
