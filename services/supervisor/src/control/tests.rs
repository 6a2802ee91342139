//! The control socket and its clients in one thread: nobody waits for anybody.

use std::net::Shutdown;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::*;

static SOCKETS: AtomicU32 = AtomicU32::new(0);

/// A socket of a test's own, whose time is the test's.
struct Desk {
    control: Control,
    path: PathBuf,
    now: Stamp,
}

impl Desk {
    fn new() -> Self {
        let number = SOCKETS.fetch_add(1, Ordering::Relaxed);
        let name = format!("teseo-control-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        let control = Control::bind(&path).unwrap();
        Self { control, path, now: Stamp::from_nanoseconds(1) }
    }

    fn connect(&self) -> UnixStream {
        let client = UnixStream::connect(&self.path).unwrap();
        client.set_nonblocking(true).unwrap();
        client
    }

    fn turn(&mut self) -> Vec<(ClientId, Request)> {
        self.control.turn(self.now)
    }

    fn pass(&mut self, duration: Duration) -> Vec<(ClientId, Request)> {
        self.now = self.now.after(duration);
        self.turn()
    }

    /// One who has asked for `line`, and is served.
    fn client(&mut self, line: &str) -> (UnixStream, ClientId) {
        let mut client = self.connect();
        writeln!(client, "{line}").unwrap();
        let requests = self.turn();
        assert_eq!(requests.len(), 1, "{line}");
        (client, requests[0].0)
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// What has come so far, and whether there will be no more.
fn read(client: &mut UnixStream) -> (String, bool) {
    let mut bytes = Vec::new();
    // What came before an error is kept.
    let has_ended = match client.read_to_end(&mut bytes) {
        Ok(_) => true,
        Err(cause) => cause.kind() != ErrorKind::WouldBlock,
    };
    (String::from_utf8_lossy(&bytes).into_owned(), has_ended)
}

const FOLLOW: &str = r#"{"verb":"events","follow":true}"#;

#[test]
fn a_request_is_answered_and_the_client_let_go() {
    let mut desk = Desk::new();
    let (mut client, id) = desk.client(r#"{"verb":"ping"}"#);
    desk.control.reply(id, &json!({ "ok": true }));
    desk.control.close(id);

    assert_eq!(read(&mut client), ("{\"ok\":true}\n".to_owned(), true));
    assert!(!desk.control.has(id));
    assert_eq!(desk.control.ignored(), 0);
}

#[test]
fn only_its_user_can_open_the_socket_and_a_stale_one_is_replaced() {
    let desk = Desk::new();
    let mode = fs::metadata(&desk.path).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);

    drop(Control::bind(&desk.path).unwrap());
}

#[test]
fn one_who_closes_its_writing_half_is_answered_and_one_who_goes_is_forgotten() {
    let mut desk = Desk::new();
    let (mut half, half_id) = desk.client(FOLLOW);
    let (gone, gone_id) = desk.client(FOLLOW);
    half.shutdown(Shutdown::Write).unwrap();
    drop(gone);
    desk.turn();

    assert!(desk.control.has(half_id) && !desk.control.has(gone_id));
    desk.control.reply(half_id, &json!(1));
    desk.turn();
    assert_eq!(read(&mut half), ("1\n".to_owned(), false));
}

#[test]
fn one_who_closes_its_writing_half_does_not_keep_the_supervisor_awake() {
    let mut desk = Desk::new();
    let (half, _) = desk.client(FOLLOW);
    half.shutdown(Shutdown::Write).unwrap();
    desk.turn();

    let mut fds = desk.control.fds();
    assert_eq!(rustix::event::poll(&mut fds, Some(&Timespec::default())), Ok(0));
}

#[test]
fn one_who_asks_and_goes_is_heard() {
    let mut desk = Desk::new();
    let mut client = desk.connect();
    writeln!(client, r#"{{"verb":"down"}}"#).unwrap();
    drop(client);

    assert!(matches!(desk.turn()[..], [(_, Request::Down)]));
    assert_eq!(desk.control.next_deadline(), None, "nobody is left");
}

#[test]
fn nonsense_is_told_what_is_wrong_counted_and_let_go() {
    let mut desk = Desk::new();
    for nonsense in
        [&b"\n"[..], b"{}\n", b"{\"verb\":\"destroy\"}\n", &vec![0xff; 100_000], b"{\"verb\":"]
    {
        let mut client = desk.connect();
        client.write_all(nonsense).unwrap();
        client.shutdown(Shutdown::Write).unwrap();
        assert_eq!(desk.turn(), []);
        desk.turn();
        let (text, has_ended) = read(&mut client);
        assert!(text.starts_with("{\"error\":") && has_ended, "{text}");
    }
    assert_eq!(desk.control.ignored(), 5);
    assert_eq!(desk.control.next_deadline(), None);
}

#[test]
fn one_who_says_nothing_is_dropped_after_a_second() {
    let mut desk = Desk::new();
    let mut client = desk.connect();
    client.write_all(b"{\"verb\"").unwrap();
    desk.turn();
    assert_eq!(desk.control.next_deadline(), Some(desk.now.after(REQUEST_PATIENCE)));

    desk.pass(REQUEST_PATIENCE / 2);
    assert!(!read(&mut client).1);
    desk.pass(REQUEST_PATIENCE / 2);
    let (text, has_ended) = read(&mut client);
    assert!(text.contains("no request came within 1s") && has_ended, "{text}");
    assert_eq!(desk.control.ignored(), 1);
}

#[test]
fn the_seventeenth_is_told_so() {
    let mut desk = Desk::new();
    let clients: Vec<_> = (0..CLIENTS_MAX).map(|_| desk.client(FOLLOW)).collect();
    let mut one_more = desk.connect();
    desk.turn();

    let (text, has_ended) = read(&mut one_more);
    assert!(text.contains("16 are connected") && has_ended, "{text}");
    drop(clients);
    desk.turn();
    desk.client(r#"{"verb":"ping"}"#);
}

#[test]
fn one_who_does_not_read_is_dropped_and_its_queue_has_an_end() {
    let mut desk = Desk::new();
    let (client, id) = desk.client(FOLLOW);
    let line = json!("x".repeat(1000));
    for _ in 0..600 {
        desk.control.reply(id, &line);
        desk.turn();
    }
    assert!(desk.control.has(id), "it may still begin to read");

    desk.pass(STALL_PATIENCE);
    assert!(!desk.control.has(id));
    drop(client);
}

#[test]
fn one_who_reads_gets_more_than_may_wait_for_one_who_does_not() {
    let mut desk = Desk::new();
    let (mut client, id) = desk.client(FOLLOW);
    let line = json!("x".repeat(997));
    for _ in 0..2_000 {
        desk.control.reply(id, &line);
    }
    desk.control.close(id);
    let (mut text, mut has_ended) = read(&mut client);
    while !has_ended {
        desk.pass(STALL_PATIENCE / 2);
        let (more, end) = read(&mut client);
        text.push_str(&more);
        has_ended = end;
    }

    assert_eq!(text.len(), 2_000_000);
}

#[test]
fn one_who_is_told_too_much_hears_so_at_the_end() {
    let mut desk = Desk::new();
    let (mut client, id) = desk.client(FOLLOW);
    let line = json!("x".repeat(100_000));
    for _ in 0..100 {
        desk.control.reply(id, &line);
        let queued: usize = desk.control.clients.iter().map(|client| client.queued.len()).sum();
        assert!(queued < QUEUE_MAX + 200);
    }
    let (mut text, mut has_ended) = read(&mut client);
    while !has_ended {
        desk.turn();
        let (more, end) = read(&mut client);
        text.push_str(&more);
        has_ended = end;
    }

    assert!(text.ends_with("\"there is too much to tell at once; ask for less\"}\n"));
}

#[test]
fn one_who_leaves_without_reading_keeps_its_place_for_a_while_only() {
    let mut desk = Desk::new();
    let (_client, id) = desk.client(FOLLOW);
    let line = json!("x".repeat(1000));
    for _ in 0..400 {
        desk.control.reply(id, &line);
    }
    desk.control.close(id);
    desk.pass(LEAVING_PATIENCE / 2);
    assert!(desk.control.has(id));

    desk.pass(LEAVING_PATIENCE / 2);
    assert!(!desk.control.has(id));
}

#[test]
fn nothing_that_clients_do_makes_the_supervisor_grow_or_stop() {
    const SEED: u64 = 5;
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut desk = Desk::new();
    let mut clients: Vec<UnixStream> = Vec::new();
    let mut served = Vec::new();
    for round in 0..5_000 {
        match random.next_u32() % 6 {
            0 if clients.len() < 3 * CLIENTS_MAX => clients.push(desk.connect()),
            1 if !clients.is_empty() => {
                let index = random.next_u32() as usize % clients.len();
                clients.swap_remove(index);
            }
            2 if !served.is_empty() => {
                let id = served[random.next_u32() as usize % served.len()];
                desk.control.reply(id, &json!("x".repeat(random.next_u32() as usize % 100_000)));
            }
            3 if !served.is_empty() => desk.control.close(served[0]),
            _ => {}
        }
        for client in &mut clients {
            let mut bytes = [0; 512];
            random.fill_bytes(&mut bytes);
            let _ = match random.next_u32() % 8 {
                0 => client.write_all(&bytes),
                1 => client.write_all(FOLLOW.as_bytes()),
                2 => client.write_all(b"\n"),
                3 => client.read(&mut bytes).map(drop),
                4 => client.shutdown(Shutdown::Write),
                _ => Ok(()),
            };
        }
        let more = desk.pass(Duration::from_millis(u64::from(random.next_u32() % 200)));
        served.extend(more.into_iter().map(|(id, _)| id));
        served.retain(|&id| desk.control.has(id));
        let queues = desk.control.clients.iter().map(|client| client.queued.len());
        assert!(queues.max().unwrap_or_default() < QUEUE_MAX + 200, "SEED={SEED}: round {round}");
        assert!(desk.control.clients.len() <= CLIENTS_MAX, "SEED={SEED}: round {round}");
    }
    assert!(0 < desk.control.ignored(), "SEED={SEED}: nobody said anything");
}
