//! The open connections. Their number is limited; one without a request yet is closed when another arrives.

use std::collections::BTreeMap;
use std::net::{Shutdown, TcpStream};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Maximum number of connections: eight pages, each with its event stream and three connections for loading (browsers open up to six per
/// host).
pub(super) const CONNECTIONS: usize = 32;

/// All connections, in order of arrival.
#[derive(Default)]
pub(super) struct Guests(Mutex<Book>);

#[derive(Default)]
struct Book {
    next: u64,
    /// A handle to those without a request yet; `None` for the others.
    guests: BTreeMap<u64, Option<TcpStream>>,
}

impl Guests {
    fn book(&self) -> MutexGuard<'_, Book> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Registers a connection and returns its number. At the limit, the oldest one without a request is closed; if there is none, returns
    /// `None`.
    pub(super) fn admit(&self, stream: &TcpStream) -> Option<u64> {
        let mut book = self.book();
        if book.guests.len() >= CONNECTIONS {
            let oldest = book.guests.iter().find(|(_, waits)| waits.is_some());
            let oldest = *oldest?.0;
            if let Some(Some(waits)) = book.guests.remove(&oldest) {
                // Its thread sees the end of the connection. An error means that it is already closed.
                let _ = waits.shutdown(Shutdown::Both);
            }
        }
        let guest = book.next;
        book.next += 1;
        book.guests.insert(guest, Some(stream.try_clone().ok()?));
        Some(guest)
    }

    /// Marks a connection as having sent its request, so that it is kept.
    pub(super) fn asked(&self, guest: u64) {
        if let Some(waits) = self.book().guests.get_mut(&guest) {
            *waits = None;
        }
    }

    pub(super) fn leave(&self, guest: u64) {
        self.book().guests.remove(&guest);
    }

    #[cfg(test)]
    pub(super) fn count(&self) -> usize {
        self.book().guests.len()
    }
}
