//! Reads a byte stream on another thread, so that no byte is lost while the caller is busy.

use crate::READ_TIMEOUT;
use crate::carrier::is_pause;
use std::io::{self, Cursor, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread::{self, JoinHandle};

/// Largest number of chunks that wait for the caller: those of more than a minute at the highest rate of a link, also if a read
/// returns only 64 bytes, and at most 256 MiB. After that, the thread waits, and the operating system discards bytes of a serial
/// port.
const MOST_CHUNKS: usize = 65_536;
/// Size of a chunk, bytes.
const CHUNK_BYTES: usize = 4096;

/// A byte stream that another thread reads. Without it, a serial port loses bytes while the caller writes to a slow disk: the
/// operating system stores only some thousand bytes, and the insole does not wait. A read waits at most [`READ_TIMEOUT`].
pub struct ReadAhead<W> {
    writer: W,
    chunks: Receiver<io::Result<Vec<u8>>>,
    /// The bytes of the last chunk; its position is that of the next byte to return.
    chunk: Cursor<Vec<u8>>,
    has_ended: Arc<AtomicBool>,
    /// `None` once it was joined.
    thread: Option<JoinHandle<()>>,
}

impl<W> ReadAhead<W> {
    /// Reads `reader` until this value is dropped. `reader` and `writer` are two handles of one byte stream, and a read of
    /// `reader` must return within a second, with [`io::ErrorKind::TimedOut`] or [`io::ErrorKind::WouldBlock`] if no byte
    /// arrived.
    pub fn new(mut reader: impl Read + Send + 'static, writer: W) -> Self {
        let (sender, chunks) = mpsc::sync_channel(MOST_CHUNKS);
        let has_ended = Arc::new(AtomicBool::new(false));
        let ends = has_ended.clone();
        let thread = thread::spawn(move || {
            let mut buffer = [0; CHUNK_BYTES];
            while !ends.load(Ordering::Relaxed) {
                let chunk = match reader.read(&mut buffer) {
                    Ok(0) => return,
                    Ok(count) => Ok(buffer[..count].to_vec()),
                    Err(e) if is_pause(&e) => continue,
                    Err(e) => Err(e),
                };
                let is_error = chunk.is_err();
                // This fails while the caller drops its end.
                if sender.send(chunk).is_err() || is_error {
                    return;
                }
            }
        });
        Self { writer, chunks, chunk: Cursor::default(), has_ended, thread: Some(thread) }
    }
}

impl<W> Read for ReadAhead<W> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.chunk.position() == self.chunk.get_ref().len() as u64 {
            self.chunk = match self.chunks.recv_timeout(READ_TIMEOUT) {
                Ok(chunk) => Cursor::new(chunk?),
                Err(RecvTimeoutError::Timeout) => return Err(io::ErrorKind::TimedOut.into()),
                // The thread has read the end of the stream.
                Err(RecvTimeoutError::Disconnected) => return Ok(0),
            };
        }
        self.chunk.read(buffer)
    }
}

impl<W: Write> Write for ReadAhead<W> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.writer.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

impl<W> Drop for ReadAhead<W> {
    fn drop(&mut self) {
        self.has_ended.store(true, Ordering::Relaxed);
        // The thread may wait for room in the queue. Without a receiver, it ends.
        self.chunks = mpsc::sync_channel(0).1;
        if let Some(thread) = self.thread.take() {
            // A serial port can be opened again only once the thread has closed its handle. A panic of the thread has already
            // been printed, and has no further effect.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{Ipv4Addr, TcpListener, TcpStream};
    use std::sync::atomic::AtomicUsize;
    use std::time::Duration;

    /// Two ends of a connection. Writes and reads of the second one fail after a timeout.
    fn ends() -> io::Result<(ReadAhead<TcpStream>, TcpStream)> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let one = TcpStream::connect(listener.local_addr()?)?;
        let (other, _) = listener.accept()?;
        one.set_read_timeout(Some(READ_TIMEOUT))?;
        other.set_write_timeout(Some(Duration::from_secs(10)))?;
        other.set_read_timeout(Some(Duration::from_secs(10)))?;
        Ok((ReadAhead::new(one.try_clone()?, one), other))
    }

    /// The operating system stores only a few megabytes of the connection.
    #[test]
    fn bytes_that_arrive_while_the_caller_is_busy_are_not_lost() {
        let (mut stream, mut other) = ends().expect("a connection");
        let sent: Vec<u8> = (0..16_u32 << 20).map(|i| (i / 251) as u8).collect();
        other.write_all(&sent).expect("the thread reads ahead");
        let (mut received, mut timeouts, mut buffer) = (Vec::new(), 0, [0; 1000]);
        while received.len() < sent.len() && timeouts < 200 {
            match stream.read(&mut buffer) {
                Ok(count) => received.extend_from_slice(&buffer[..count]),
                Err(error) if error.kind() == io::ErrorKind::TimedOut => timeouts += 1,
                Err(error) => panic!("{error}"),
            }
        }
        assert!(received == sent);
        assert_eq!(stream.read(&mut buffer).expect_err("there are no more bytes").kind(), io::ErrorKind::TimedOut);
        drop(other);
        assert!((0..200).any(|_| matches!(stream.read(&mut buffer), Ok(0))));
    }

    /// A device that sends more than the program reads does not exhaust the memory, and the thread ends although it waits.
    #[test]
    fn a_thread_that_waits_for_room_in_the_queue_ends_with_the_stream() {
        /// Counts the reads.
        struct Endless(Arc<AtomicUsize>);
        impl Read for Endless {
            fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
                self.0.fetch_add(1, Ordering::Relaxed);
                Ok(buffer.len().min(1))
            }
        }
        let reads = Arc::new(AtomicUsize::new(0));
        let stream = ReadAhead::new(Endless(reads.clone()), io::sink());
        // The last chunk that was read does not fit into the queue.
        while reads.load(Ordering::Relaxed) <= MOST_CHUNKS {
            thread::yield_now();
        }
        drop(stream);
        assert_eq!(reads.load(Ordering::Relaxed), MOST_CHUNKS + 1);
    }

    #[test]
    fn the_stream_is_closed_when_it_is_dropped() {
        let (stream, mut other) = ends().expect("a connection");
        drop(stream);
        assert_eq!(other.read(&mut [0]).expect("the end"), 0);
    }
}
