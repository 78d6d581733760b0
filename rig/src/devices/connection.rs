//! What links run over: TCP connections and serial ports.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use crate::DeviceError;

/// What a [`Link`](super::Link) runs over: anything that can be read with a time limit.
pub trait Connection: Send {
    /// Reads what is there, waiting for `wait` at most.
    ///
    /// # Errors
    /// `TimedOut` or `WouldBlock` if nothing came; anything else means that the connection is gone.
    /// `Ok(0)` means the same.
    fn read(&mut self, into: &mut [u8], wait: Duration) -> io::Result<usize>;

    /// Writes all of `bytes`, waiting for `wait` at most.
    ///
    /// # Errors
    /// Those of the connection.
    fn write(&mut self, bytes: &[u8], wait: Duration) -> io::Result<()>;
}

/// Nothing came, which is no error yet.
pub(super) fn is_timeout(error: &io::Error) -> bool {
    use io::ErrorKind as K;
    matches!(error.kind(), K::TimedOut | K::WouldBlock | K::Interrupted)
}

impl Connection for TcpStream {
    fn read(&mut self, into: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.set_read_timeout(Some(wait))?;
        Read::read(self, into)
    }

    fn write(&mut self, bytes: &[u8], wait: Duration) -> io::Result<()> {
        self.set_write_timeout(Some(wait))?;
        self.write_all(bytes)
    }
}

/// Connects to a TCP port.
pub(super) fn connect(
    device: &str,
    host: &str,
    port: u16,
    wait: Duration,
) -> Result<Box<dyn Connection>, DeviceError> {
    let device = || device.to_owned();
    let addresses = (host, port).to_socket_addrs();
    let addresses = addresses.map_err(|_| DeviceError::NotFound { device: device() })?;
    let mut last = DeviceError::NotFound { device: device() };
    for address in addresses {
        last = match TcpStream::connect_timeout(&address, wait) {
            Ok(stream) => {
                // Commands are a few bytes each, and each waits for its answer. A system that
                // cannot switch the delay off is slower, no more.
                let _ = stream.set_nodelay(true);
                return Ok(Box::new(stream));
            }
            Err(error) if is_timeout(&error) => {
                DeviceError::Timeout { device: device(), waited_s: wait.as_secs_f64() }
            }
            Err(_) => DeviceError::NotFound { device: device() },
        };
    }
    Err(last)
}

impl Connection for Box<dyn serialport::SerialPort> {
    fn read(&mut self, into: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.set_timeout(wait)?;
        Read::read(self, into)
    }

    fn write(&mut self, bytes: &[u8], wait: Duration) -> io::Result<()> {
        self.set_timeout(wait)?;
        self.write_all(bytes)
    }
}

/// Opens a serial port.
pub(super) fn open_serial(
    device: &str,
    path: &str,
    baud: u32,
    wait: Duration,
) -> Result<Box<dyn Connection>, DeviceError> {
    match serialport::new(path, baud).timeout(wait).open() {
        Ok(port) => Ok(Box::new(port)),
        Err(error) => Err(serial_error(device, path, &error)),
    }
}

/// What keeps a serial port from being opened.
fn serial_error(device: &str, path: &str, error: &serialport::Error) -> DeviceError {
    use serialport::ErrorKind as K;
    let (device, path) = (device.to_owned(), path.to_owned());
    match error.kind {
        K::Io(io::ErrorKind::NotFound) => DeviceError::NotFound { device },
        K::Io(io::ErrorKind::PermissionDenied) => DeviceError::NoPermission { device, path },
        // Somebody else's exclusive lock on the port.
        K::NoDevice => DeviceError::Busy { device },
        _ => DeviceError::Unsupported {
            device,
            reason: format!("{path} does not open as a serial port: {}", error.description),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Link, Patience};
    use super::*;
    use crate::DeviceErrorKind;

    #[test]
    fn a_port_in_use_and_one_that_is_forbidden_are_told_apart() {
        let kind = |kind| serial_error("x", "/dev/x", &serialport::Error::new(kind, "")).kind();
        use serialport::ErrorKind as K;
        assert_eq!(kind(K::NoDevice), DeviceErrorKind::Busy);
        assert_eq!(kind(K::Io(io::ErrorKind::PermissionDenied)), DeviceErrorKind::NoPermission);
        assert_eq!(kind(K::Io(io::ErrorKind::NotFound)), DeviceErrorKind::NotFound);
        assert_eq!(kind(K::Unknown), DeviceErrorKind::Unsupported);
    }

    #[test]
    fn nobody_at_the_port_is_not_found() {
        // Bound and closed again: nobody listens there.
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut link = Link::tcp("projector", "127.0.0.1", port, Patience::default());
        assert_eq!(link.connect().unwrap_err().kind(), DeviceErrorKind::NotFound);
    }
}
