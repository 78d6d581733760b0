//! Frames of a device, in memory that it shares with this program.

use std::io;
use std::os::fd::AsRawFd;
use std::time::{Duration, Instant};

use ::v4l::v4l_sys as sys;
use ::v4l::v4l2::vidioc;

use super::node::{CAPTURE, Node};

/// One is filled while another is looked at, and one waits.
const BUFFERS: u32 = 3;

/// A device that sends pictures from when it is made until it is dropped.
pub struct Stream<'a> {
    node: &'a Node,
    buffers: Vec<Mapped>,
}

/// A buffer's memory.
struct Mapped {
    at: *mut libc::c_void,
    length: usize,
}

/// One picture, as it came.
pub struct Raw {
    pub bytes: Vec<u8>,
    /// Whether the driver itself says that something is missing.
    pub broken: bool,
    pub sequence: u32,
    /// By the clock of the machine, where the driver tells.
    pub at: Option<Duration>,
}

impl<'a> Stream<'a> {
    pub fn start(node: &'a Node) -> io::Result<Self> {
        let count = node.request_buffers(BUFFERS)?;
        let mut stream = Self { node, buffers: Vec::new() };
        for index in 0..count {
            let mut buffer = blank(index);
            // SAFETY: the request's own structure.
            unsafe { node.call(vidioc::VIDIOC_QUERYBUF, &mut buffer)? };
            stream.buffers.push(Mapped::new(node, &buffer)?);
            stream.queue(index)?;
        }
        if stream.buffers.is_empty() {
            return Err(io::Error::from_raw_os_error(libc::ENOMEM));
        }
        let mut kind = CAPTURE as libc::c_int;
        // SAFETY: the request takes an int.
        unsafe { node.call(vidioc::VIDIOC_STREAMON, &mut kind)? };
        Ok(stream)
    }

    fn queue(&self, index: u32) -> io::Result<()> {
        let mut buffer = blank(index);
        // SAFETY: the request's own structure.
        unsafe { self.node.call(vidioc::VIDIOC_QBUF, &mut buffer) }
    }

    /// The next picture, within `limit`.
    ///
    /// # Errors
    /// `TimedOut`, or whatever the driver says.
    pub fn next(&self, limit: Duration) -> io::Result<Raw> {
        let until = Instant::now() + limit;
        loop {
            let mut buffer = blank(0);
            // SAFETY: the request's own structure.
            match unsafe { self.node.call(vidioc::VIDIOC_DQBUF, &mut buffer) } {
                Ok(()) => return self.read(&buffer),
                Err(error) if error.raw_os_error() == Some(libc::EAGAIN) => {}
                Err(error) => return Err(error),
            }
            self.wait(until)?;
        }
    }

    fn wait(&self, until: Instant) -> io::Result<()> {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        let mut poll =
            libc::pollfd { fd: self.node.file().as_raw_fd(), events: libc::POLLIN, revents: 0 };
        // Rounded up, or the last millisecond would be spun away.
        let left_ms = i32::try_from(left.as_millis() + 1).unwrap_or(i32::MAX);
        // SAFETY: one structure, as is said.
        let ready = unsafe { libc::poll(&mut poll, 1, left_ms) };
        let error = io::Error::last_os_error();
        if ready < 0 && error.raw_os_error() != Some(libc::EINTR) {
            return Err(error);
        }
        if ready > 0 && poll.revents & libc::POLLIN == 0 {
            // Nothing will come any more; what is wrong is said by the call that asks for it, and
            // where it says nothing the device is gone.
            let mut buffer = blank(0);
            // SAFETY: the request's own structure.
            unsafe { self.node.call(vidioc::VIDIOC_DQBUF, &mut buffer) }.map_err(|error| {
                match error.raw_os_error() {
                    Some(libc::EAGAIN) => io::Error::from_raw_os_error(libc::ENODEV),
                    _ => error,
                }
            })?;
            self.queue(buffer.index)?;
        }
        Ok(())
    }

    fn read(&self, buffer: &sys::v4l2_buffer) -> io::Result<Raw> {
        let mapped = self.buffers.get(buffer.index as usize);
        let mapped = mapped.ok_or_else(|| io::Error::from_raw_os_error(libc::EIO))?;
        let length = mapped.length.min(buffer.bytesused as usize);
        // SAFETY: the memory is mapped for as long as `self` lives; the driver leaves the buffer
        // alone until it is queued again, below.
        let bytes = unsafe { std::slice::from_raw_parts(mapped.at.cast::<u8>(), length) }.to_vec();
        self.queue(buffer.index)?;
        let monotonic = buffer.flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC != 0;
        let (s, us) = (buffer.timestamp.tv_sec, buffer.timestamp.tv_usec);
        let at = u64::try_from(s).ok().zip(u64::try_from(us).ok()).filter(|_| monotonic);
        Ok(Raw {
            bytes,
            broken: buffer.flags & sys::V4L2_BUF_FLAG_ERROR != 0,
            sequence: buffer.sequence,
            at: at.map(|(s, us)| Duration::from_secs(s).saturating_add(Duration::from_micros(us))),
        })
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        let mut kind = CAPTURE as libc::c_int;
        // A device that is gone takes no goodbye, and there is nobody left to tell.
        // SAFETY: the request takes an int.
        let _ = unsafe { self.node.call(vidioc::VIDIOC_STREAMOFF, &mut kind) };
        self.buffers.clear();
        let _ = self.node.request_buffers(0);
    }
}

impl Mapped {
    fn new(node: &Node, buffer: &sys::v4l2_buffer) -> io::Result<Self> {
        let length = buffer.length as usize;
        // SAFETY: the driver chose the offset for this file; of this memory type the union holds
        // it. The kernel refuses what is none of the device's.
        let at = unsafe {
            ::v4l::v4l2::mmap(
                std::ptr::null_mut(),
                length,
                libc::PROT_READ | libc::PROT_WRITE,
                libc::MAP_SHARED,
                node.file().as_raw_fd(),
                libc::off_t::from(buffer.m.offset),
            )?
        };
        Ok(Self { at, length })
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        // SAFETY: it was mapped with this length, and nothing else knows of it.
        let _ = unsafe { ::v4l::v4l2::munmap(self.at, self.length) };
    }
}

fn blank(index: u32) -> sys::v4l2_buffer {
    // SAFETY: a plain structure of numbers and pointers that are not looked at.
    let mut buffer: sys::v4l2_buffer = unsafe { std::mem::zeroed() };
    (buffer.index, buffer.type_) = (index, CAPTURE);
    buffer.memory = sys::v4l2_memory_V4L2_MEMORY_MMAP;
    buffer
}
