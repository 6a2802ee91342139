//! What people would use otherwise: a Unix domain socket, or two named pipes. The payload is copied
//! twice.

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;

use hdrhistogram::Histogram;
use interfaces::Stamp;
use node::{Error, Namespace, Result, clock};
use rustix::fs::Mode;
use rustix::io::Errno;

use super::side::{Arrival, Body, End, LIFE_MAX, Link, await_peer};
use crate::payload::{expected, sum, word};
use crate::peers::Role;

/// [word] Number and stamp.
const HEADER: usize = 4;

pub(super) fn with_socket(
    end: &End<'_>,
    namespace: &Namespace,
    body: Body<'_>,
) -> Result<Histogram<u64>> {
    namespace.create_directory()?;
    let path = namespace.directory().join("hop.socket");
    let failed = |cause| Error::File { path: path.clone(), cause };
    let stream = match end.role {
        Role::Sender => UnixListener::bind(&path).map_err(failed)?.accept().map_err(failed)?.0,
        Role::Reader(_) => {
            let until = clock::now().after(LIFE_MAX);
            let mut stream = None;
            await_peer(until, || {
                stream = UnixStream::connect(&path).ok();
                stream.is_some()
            })?;
            stream.ok_or_else(|| Error::Fault("nobody listens".to_owned()))?
        }
    };
    stream.set_read_timeout(Some(LIFE_MAX)).map_err(failed)?;
    body(&mut Bytes::new(end, &stream, &stream))
}

pub(super) fn with_pipes(
    end: &End<'_>,
    namespace: &Namespace,
    body: Body<'_>,
) -> Result<Histogram<u64>> {
    namespace.create_directory()?;
    let names = ["question", "answer"].map(|name| namespace.directory().join(name));
    for name in &names {
        match rustix::fs::mkfifoat(rustix::fs::CWD, name, Mode::RUSR | Mode::WUSR) {
            Ok(()) | Err(Errno::EXIST) => {}
            Err(cause) => return Err(Error::File { path: name.clone(), cause: cause.into() }),
        }
    }
    let open = |path: &PathBuf, writes: bool| {
        let opened = File::options().read(!writes).write(writes).open(path);
        opened.map_err(|cause| Error::File { path: path.clone(), cause })
    };
    // To open an end waits for the other one, so both sides begin with the same pipe.
    let (read, written) = match end.role {
        Role::Sender => {
            let written = open(&names[0], true)?;
            (open(&names[1], false)?, written)
        }
        Role::Reader(_) => {
            let read = open(&names[0], false)?;
            (read, open(&names[1], true)?)
        }
    };
    body(&mut Bytes::new(end, &read, &written))
}

struct Bytes<R, W> {
    read: R,
    written: W,
    /// What is sent, and what was received.
    words: [Vec<u32>; 2],
}

impl<R: Read, W: Write> Bytes<R, W> {
    fn new(end: &End<'_>, read: R, written: W) -> Self {
        let words = vec![0; end.hop.size.bytes() / 4];
        Self { read, written, words: [words.clone(), words] }
    }
}

impl<R: Read, W: Write> Link for Bytes<R, W> {
    fn send(&mut self, number: u64, stamp: Stamp) -> Result {
        let [words, _] = &mut self.words;
        let header = bytemuck::cast::<[u64; 2], [u32; HEADER]>([number, stamp.nanoseconds]);
        words[..HEADER].copy_from_slice(&header);
        words[HEADER..].fill(word(number));
        self.written.write_all(bytemuck::cast_slice(words)).map_err(|cause| gone(&cause))
    }

    fn receive(&mut self) -> Result<Arrival> {
        let [_, words] = &mut self.words;
        self.read.read_exact(bytemuck::cast_slice_mut(words)).map_err(|cause| gone(&cause))?;
        let (header, payload) = words.split_at(HEADER);
        let mut both = [0; HEADER];
        both.copy_from_slice(header);
        let [number, stamp] = bytemuck::cast::<[u32; HEADER], [u64; 2]>(both);
        let intact = sum(payload) == expected(payload.len(), number);
        Ok(Arrival { number, stamp: Stamp::from_nanoseconds(stamp), intact })
    }
}

fn gone(cause: &std::io::Error) -> Error {
    Error::Fault(format!("the other side is gone: {cause}"))
}
