//! What processes tell the supervisor about themselves: `sd_notify(3)`'s protocol, on a datagram
//! socket whose messages carry their sender's process id by the kernel's word.

use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::Duration;

use node::{Error, Result};
use rustix::io::IoSliceMut;
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, ReturnFlags};

/// [byte] As much as systemd takes (`NOTIFY_BUFFER_MAX`); a longer message is none.
const DATAGRAM_MAX: usize = 4096;

/// [byte] Of a status, which has one line on the screen.
const STATUS_MAX: usize = 256;

/// However long a process asks for, it is not for ever.
const EXTENSION_MAX: Duration = Duration::from_secs(3600);

/// One message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Datagram {
    /// [-] Who sent it.
    pub(crate) pid: i32,
    pub(crate) words: Vec<Word>,
}

/// One thing that a process says about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Word {
    /// It does what it was started for.
    Ready,
    /// Its loop turns.
    Watchdog,
    /// It asks to be treated as if its loop did not.
    WatchdogTrigger,
    /// What it is doing may take so much longer.
    ExtendTimeout(Duration),
    /// In one line, what it is doing.
    Status(String),
    /// That there is something new to see elsewhere, or what means nothing to us.
    Other,
}

/// Where the processes of a robot tell how they are.
#[derive(Debug)]
pub(crate) struct NotifySocket {
    socket: UnixDatagram,
    ignored: u64,
}

impl NotifySocket {
    pub(crate) fn bind(path: &Path) -> Result<Self> {
        let failed = |cause| Error::File { path: path.to_owned(), cause };
        let socket = UnixDatagram::bind(path).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        rustix::net::sockopt::set_socket_passcred(&socket, true)
            .map_err(|cause| failed(cause.into()))?;
        Ok(Self { socket, ignored: 0 })
    }

    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    /// The next message; what is no message is counted and passed over.
    pub(crate) fn receive(&mut self) -> Option<Datagram> {
        let mut bytes = [0; DATAGRAM_MAX];
        loop {
            let mut space =
                [MaybeUninit::uninit(); rustix::cmsg_space!(ScmCredentials(1), ScmRights(8))];
            let mut credentials = RecvAncillaryBuffer::new(&mut space);
            let mut parts = [IoSliceMut::new(&mut bytes)];
            let flags = RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
            let received =
                rustix::net::recvmsg(&self.socket, &mut parts, &mut credentials, flags).ok()?;
            // File descriptors that came along are closed here, with their buffer.
            let pid = credentials.drain().find_map(|message| match message {
                RecvAncillaryMessage::ScmCredentials(sender) => {
                    Some(sender.pid.as_raw_nonzero().get())
                }
                _ => None,
            });
            let is_whole = !received.flags.contains(ReturnFlags::TRUNC);
            let words = parse(&bytes[..received.bytes.min(DATAGRAM_MAX)]);
            match (pid, words) {
                (Some(pid), Some(words)) if is_whole => return Some(Datagram { pid, words }),
                _ => self.ignored += 1,
            }
        }
    }

    /// Counts a message of somebody who is no process of the robot.
    pub(crate) fn ignore_stranger(&mut self) {
        self.ignored += 1;
    }

    /// [-] Messages that were none, or whose sender is no process of the robot.
    pub(crate) const fn ignored(&self) -> u64 {
        self.ignored
    }
}

/// The words of a message, or nothing where it is not made of `NAME=value` lines.
fn parse(bytes: &[u8]) -> Option<Vec<Word>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let lines = text.split('\n').filter(|line| !line.is_empty());
    let words: Option<Vec<_>> = lines.map(word).collect();
    words.filter(|words| !words.is_empty())
}

fn word(line: &str) -> Option<Word> {
    let (name, value) = line.split_once('=')?;
    if name.is_empty() || value.contains('\0') {
        return None;
    }
    Some(match (name, value) {
        ("READY", "1") => Word::Ready,
        ("WATCHDOG", "1") => Word::Watchdog,
        ("WATCHDOG", "trigger") => Word::WatchdogTrigger,
        ("EXTEND_TIMEOUT_USEC", microseconds) => {
            let more = Duration::from_micros(microseconds.parse().ok()?);
            Word::ExtendTimeout(more.min(EXTENSION_MAX))
        }
        ("STATUS", text) => Word::Status(one_line(text)),
        _ => Word::Other,
    })
}

/// What a terminal can be shown, whatever a process has sent.
fn one_line(text: &str) -> String {
    let mut line = String::new();
    for character in text.chars() {
        if STATUS_MAX < line.len() + character.len_utf8() {
            break;
        }
        line.push(if character.is_control() { ' ' } else { character });
    }
    line
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;

    #[test]
    fn the_protocol_s_words_are_known() {
        let said = b"READY=1\nSTATUS=at work\nWATCHDOG=1\nEXTEND_TIMEOUT_USEC=2500000\nX_MINE=1\n";
        let words = [
            Word::Ready,
            Word::Status("at work".to_owned()),
            Word::Watchdog,
            Word::ExtendTimeout(Duration::from_millis(2_500)),
            Word::Other,
        ];

        assert_eq!(parse(said).unwrap(), words);
        assert_eq!(parse(b"WATCHDOG=trigger").unwrap(), [Word::WatchdogTrigger]);
    }

    #[test]
    fn what_is_no_message_is_none() {
        for nonsense in [&b""[..], b"\n", b"READY", b"=1", b"\xff=1", b"EXTEND_TIMEOUT_USEC=-1"] {
            assert_eq!(parse(nonsense), None, "{nonsense:?}");
        }
    }

    #[test]
    fn no_status_reaches_a_terminal_s_controls() {
        let text = "\u{1b}[2J\r".to_owned() + &"x".repeat(1_000);
        let words = parse(format!("STATUS={text}").as_bytes()).unwrap();
        let [Word::Status(shown)] = words.as_slice() else { panic!("{words:?}") };

        assert!(shown.len() <= STATUS_MAX && !shown.contains(char::is_control), "{shown:?}");
    }

    #[test]
    fn no_bytes_make_it_panic_or_wait_for_ever() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let alphabet = b"READYWATCHDOGSTATUSEXTEND_TIMEOUT_USEC=\n\n\n110\xff\0";
        for _ in 0..200_000 {
            let length = random.next_u64() % 48;
            let letter = |random: &mut ChaCha8Rng| {
                alphabet[usize::try_from(random.next_u64()).unwrap() % alphabet.len()]
            };
            let bytes: Vec<_> = (0..length).map(|_| letter(&mut random)).collect();
            for word in parse(&bytes).into_iter().flatten() {
                if let Word::ExtendTimeout(more) = word {
                    assert!(more <= EXTENSION_MAX, "{bytes:?}");
                }
            }
        }
    }
}
