//! A web server on loopback with the same response to every request.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

/// A server that ends with the test's process.
pub struct Server {
    /// Its address, e.g. `http://127.0.0.1:4711`.
    pub url: String,
    /// Heads of the received requests.
    pub requests: Arc<Mutex<Vec<String>>>,
}

/// Starts the server. `answer` gets a request's head and writes the whole response.
pub fn serve(
    answer: impl Fn(&str, &mut TcpStream) -> std::io::Result<()> + Send + 'static,
) -> Server {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let requests = Arc::new(Mutex::new(Vec::new()));
    let log = requests.clone();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let mut head = String::new();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            while reader.read_line(&mut head).is_ok_and(|n| n > 2) {}
            log.lock().unwrap().push(head.clone());
            // Errors of clients that left are ignored.
            let _ = answer(&head, &mut stream);
        }
    });
    Server { url, requests }
}

/// Serves one file completely for any request.
pub fn serve_file(bytes: Vec<u8>) -> Server {
    serve(move |_, stream| {
        write_head(stream, "200 OK", bytes.len())?;
        stream.write_all(&bytes)
    })
}

/// Writes a response head for a body of `length` bytes.
pub fn write_head(stream: &mut TcpStream, status: &str, length: usize) -> std::io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    )
}
