//! Serves one page and its updates to browsers that may be slow, numerous or hostile.
//!
//! No client can delay the run or another client. Every connection has its own thread, which fetches the changes since its last update,
//! writes them, and repeats: a slow browser gets fewer updates, always of the newest state. Connections, request sizes and times are
//! limited, and idle connections give way to new ones. Independent of runs; reads no files.

mod client;
mod guests;
mod request;
#[cfg(test)]
mod tests;

use crate::failure::Failure;
use guests::Guests;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::str::FromStr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Default port. 0x5350, `SP`, is not registered for any service.
const PORT: u16 = 21_328;
/// Maximum number of pages with updates.
const CLIENTS: usize = 8;
/// Time limit for the last update of pages at the end; shorter in tests.
const LAST: Duration = Duration::from_millis(if cfg!(test) { 500 } else { 3000 });

pub(crate) trait Feed: Send + Sync + 'static {
    /// Appends the changes since a version, as JSON in one line; everything for version 0. Returns the version reached.
    fn since(&self, version: u64, json: &mut Vec<u8>) -> u64;
}

/// Address to serve at: `ADDR:PORT`, `ADDR`, or `PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    host: String,
    port: Option<u16>,
}

impl Default for Place {
    fn default() -> Self {
        Self {
            host: Ipv4Addr::LOCALHOST.to_string(),
            port: None,
        }
    }
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "expected ADDR:PORT, a port, or nothing after --view, as in --view 127.0.0.1:8080, found {text}; PATH goes before --view"
            )
        };
        if text.is_empty() {
            return Ok(Self::default());
        }
        if let Ok(port) = text.parse() {
            return Ok(Self {
                port: Some(port),
                ..Self::default()
            });
        }
        let bare = text.trim_matches(['[', ']']);
        if let Ok(address) = bare.parse::<IpAddr>() {
            return Ok(Self {
                host: address.to_string(),
                port: None,
            });
        }
        let (host, port) = text.rsplit_once(':').ok_or_else(wrong)?;
        let host = host.trim_matches(['[', ']']);
        let is_name = |h: &str| {
            h.bytes()
                .all(|b| b.is_ascii_alphanumeric() || b"-.".contains(&b))
        };
        if host.is_empty() || !(is_name(host) || host.parse::<IpAddr>().is_ok()) {
            return Err(wrong());
        }
        Ok(Self {
            host: host.to_owned(),
            port: Some(port.parse().map_err(|_| wrong())?),
        })
    }
}

impl Place {
    /// Binds the port. If none was given and the default one is taken, uses any free port.
    fn bind(&self) -> Result<TcpListener, Failure> {
        let port = self.port.unwrap_or(PORT);
        let addresses: Vec<SocketAddr> = (&*self.host, port)
            .to_socket_addrs()
            .map_err(|e| self.failure(&e))?
            .collect();
        let bound = TcpListener::bind(&*addresses);
        let bound = bound.or_else(|e| match (self.port, addresses.first()) {
            (None, Some(address)) => TcpListener::bind((address.ip(), 0)),
            _ => Err(e),
        });
        bound.map_err(|e| self.failure(&e))
    }

    fn failure(&self, e: &std::io::Error) -> Failure {
        let port = self
            .port
            .map_or_else(|| "another".to_owned(), |p| p.to_string());
        Failure::input(format!(
            "--view: expected an address of this machine and a free port, found for {} and port {port}: {e}; name another with --view ADDR:PORT",
            self.host
        ))
    }
}

struct Shared {
    feed: Arc<dyn Feed>,
    html: String,
    /// The host name that the user gave, if any.
    name: String,
    /// Prefix of all paths: a secret token if other machines can connect, else empty.
    root: String,
    signal: Mutex<Signal>,
    changed: Condvar,
    /// Number of pages with updates.
    clients: AtomicUsize,
    guests: Guests,
}

type Last = Arc<Option<(&'static str, String)>>;

#[derive(Default)]
struct Signal {
    /// Number of changes.
    count: u64,
    last: Last,
    /// No further clients are admitted.
    closed: bool,
}

impl Shared {
    fn signal(&self) -> MutexGuard<'_, Signal> {
        self.signal.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits up to `time` for a change after count `seen`. Returns the last event once there is one.
    fn wait(&self, seen: &mut Option<u64>, time: Duration) -> Last {
        let waits = |s: &mut Signal| *seen == Some(s.count) && s.last.is_none();
        let signal = self.changed.wait_timeout_while(self.signal(), time, waits);
        let signal = signal.unwrap_or_else(PoisonError::into_inner).0;
        *seen = Some(signal.count);
        Arc::clone(&signal.last)
    }
}

pub(crate) struct Server {
    shared: Arc<Shared>,
    address: SocketAddr,
    accepting: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts the server. `prepare` is called on the thread that starts all others.
    pub(crate) fn start(
        place: &Place,
        html: String,
        feed: Arc<dyn Feed>,
        prepare: fn(),
    ) -> Result<Self, Failure> {
        let listener = place.bind()?;
        let address = listener.local_addr().map_err(|e| place.failure(&e))?;
        let is_name = place.host.parse::<IpAddr>().is_err();
        let root = if address.ip().is_loopback() {
            String::new()
        } else {
            format!("/{}", token()?)
        };
        let shared = Arc::new(Shared {
            feed,
            html,
            name: if is_name {
                place.host.clone()
            } else {
                String::new()
            },
            root,
            signal: Mutex::default(),
            changed: Condvar::new(),
            clients: AtomicUsize::new(0),
            guests: Guests::default(),
        });
        let own = Arc::clone(&shared);
        let accepting = std::thread::Builder::new().name("view".to_owned());
        let accepting = accepting.spawn(move || {
            prepare();
            accept(&listener, &own);
        });
        Ok(Self {
            shared,
            address,
            accepting: Some(accepting.map_err(Failure::thread)?),
        })
    }

    /// URL for a browser; one that other machines can use if they can connect.
    pub(crate) fn url(&self) -> String {
        let Shared { name, root, .. } = &*self.shared;
        let mut at = self.address;
        if at.ip().is_unspecified() {
            at.set_ip(address_for_others(at.ip()).unwrap_or(self.reached().ip()));
        }
        match name.is_empty() {
            false => format!("http://{name}:{}{root}/", at.port()),
            true => format!("http://{at}{root}/"),
        }
    }

    pub(crate) fn is_open(&self) -> bool {
        !self.address.ip().is_loopback()
    }

    pub(crate) fn is_watched(&self) -> bool {
        self.shared.clients.load(Ordering::Relaxed) > 0
    }

    pub(crate) fn wake(&self) {
        self.shared.signal().count += 1;
        self.shared.changed.notify_all();
    }

    /// Sends the last event to all pages: its name, and its data as JSON in one line.
    pub(crate) fn end(&self, name: &'static str, json: String) {
        let mut signal = self.shared.signal();
        if signal.last.is_none() {
            signal.last = Arc::new(Some((name, json)));
        }
        self.shared.changed.notify_all();
    }

    /// Waits until all pages have the last event, up to a time limit.
    fn wait_for_pages(&self) {
        let deadline = Instant::now() + LAST;
        while self.is_watched() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// An address by which this machine reaches the server.
    fn reached(&self) -> SocketAddr {
        let mut address = self.address;
        match address.ip() {
            IpAddr::V4(ip) if ip.is_unspecified() => address.set_ip(Ipv4Addr::LOCALHOST.into()),
            IpAddr::V6(ip) if ip.is_unspecified() => address.set_ip(Ipv6Addr::LOCALHOST.into()),
            _ => {}
        }
        address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end(
            "end",
            "\"It did not come to its end: the terminal says why.\"".to_owned(),
        );
        self.wait_for_pages();
        self.shared.signal().closed = true;
        // The thread checks the flag when a client connects.
        if TcpStream::connect_timeout(&self.reached(), LAST).is_ok()
            && let Some(accepting) = self.accepting.take()
        {
            let _ = accepting.join();
        }
    }
}

/// Accepts connections, each on its own thread.
fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    for stream in listener.incoming() {
        if shared.signal().closed {
            return;
        }
        let Ok(stream) = stream else {
            // Too many open files, or a client that left at once.
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        let Some(guest) = shared.guests.admit(&stream) else {
            continue;
        };
        let own = Arc::clone(shared);
        let thread = std::thread::Builder::new().name("view-client".to_owned());
        let started = thread.spawn(move || {
            // Also on panic.
            let _leaves = Leaves(&own.guests, guest);
            client::serve(stream, guest, &own);
        });
        if started.is_err() {
            shared.guests.leave(guest);
        }
    }
}

/// Removes a connection on drop.
struct Leaves<'a>(&'a Guests, u64);

impl Drop for Leaves<'_> {
    fn drop(&mut self) {
        self.0.leave(self.1);
    }
}

/// Decrements the counter on drop.
struct Counted<'a>(&'a AtomicUsize);

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// 128 random bits, as hexadecimal digits.
fn token() -> Result<String, Failure> {
    let mut bits = [0; 16];
    getrandom::fill(&mut bits).map_err(|e| {
        Failure::input(format!(
            "--view: expected random numbers of the system for an address that nobody can guess, found none: {e}; leave ADDR out"
        ))
    })?;
    Ok(bits.iter().map(|b| format!("{b:02x}")).collect())
}

/// An address by which other machines reach this one: that of a network interface, of the same family as the unspecified address. IPv6 also
/// accepts IPv4, whose addresses are easier to type.
fn address_for_others(unspecified: IpAddr) -> Option<IpAddr> {
    let cards = if_addrs::get_if_addrs().unwrap_or_default();
    let mut found: Vec<IpAddr> = cards
        .iter()
        .filter(|card| !card.is_loopback() && !card.is_link_local())
        .map(if_addrs::Interface::ip)
        .filter(|ip| ip.is_ipv4() || unspecified.is_ipv6())
        .collect();
    // Container bridges usually come after the physical interfaces.
    found.sort_by_key(IpAddr::is_ipv6);
    found.first().copied()
}
