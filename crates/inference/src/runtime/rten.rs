//! `rten`: pure Rust, needs no library of the system, always available.

use super::{Session, Tensor, one_line};
use rten::{Model, NodeId, RunOptions, ThreadPool, Value, ValueView};
use rten_tensor::Layout;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Name in summaries; a test compares it with Cargo.lock.
const RUNTIME: &str = "rten 0.27.0";

pub(super) struct RtenSession {
    model: Model,
    input: NodeId,
    pool: Arc<ThreadPool>,
    /// The message of a panic, after which its state is undefined.
    broken: Option<String>,
}

impl RtenSession {
    /// Loads a model with the image input `input`.
    pub(super) fn load(bytes: Vec<u8>, input: &str, threads: usize) -> Result<Self, String> {
        let model = guarded(|| Model::load(bytes).map_err(|e| one_line(&e))).unwrap_or_else(Err)?;
        let input = model.node_id(input).map_err(|e| one_line(&e))?;
        Ok(Self {
            model,
            input,
            pool: Arc::new(ThreadPool::with_num_threads(threads)),
            broken: None,
        })
    }

    /// Runs `work` on the model, unless it panicked before.
    fn attempt<T>(&mut self, work: impl FnOnce(&Self) -> Result<T, String>) -> Result<T, String> {
        if let Some(panic) = &self.broken {
            return Err(panic.clone());
        }
        guarded(|| work(self)).unwrap_or_else(|panic| {
            self.broken = Some(panic.clone());
            Err(panic)
        })
    }
}

/// The result of some work, or its panic as a one-line message: `rten` may panic on inconsistent graphs.
fn guarded<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    GUARDED.fetch_add(1, Ordering::SeqCst);
    // Unwinding is safe here: the caller discards everything that the work touched.
    let done = catch_unwind(AssertUnwindSafe(work));
    GUARDED.fetch_sub(1, Ordering::SeqCst);
    done.map_err(|panic| format!("a panic: {}", said(&*panic)))
}

/// Number of running networks whose panics become errors.
static GUARDED: AtomicUsize = AtomicUsize::new(0);

/// Whether a panic in this source file is expected: a runtime is running a network, some of which make it panic, and the file is not part
/// of this project. The panic becomes an error with its message, so a program's panic hook should print nothing.
#[must_use]
pub fn is_expected(file: &str) -> bool {
    GUARDED.load(Ordering::SeqCst) > 0 && !file.starts_with("crates/")
}

fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    match text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)) {
        Some(text) => one_line(&text),
        None => "without a message".to_owned(),
    }
}

impl Session for RtenSession {
    fn run(&mut self, planes: &[f32], width: usize, height: usize) -> Result<Vec<Tensor>, String> {
        let shape = [1, 3, height, width];
        let input = ValueView::from_shape(shape.as_slice(), planes).map_err(|e| one_line(&e))?;
        // Its own threads, since the default pool takes all cores.
        let options = RunOptions::default().with_thread_pool(Some(Arc::clone(&self.pool)));
        self.attempt(|session| {
            let outputs = session.model.run(
                vec![(session.input, input.into())],
                session.model.output_ids(),
                Some(options),
            );
            let outputs = outputs.map_err(|e| one_line(&e))?;
            outputs.into_iter().map(tensor).collect()
        })
    }

    fn runtime(&self) -> &str {
        RUNTIME
    }
}

fn tensor(value: Value) -> Result<Tensor, String> {
    let shape = value.shape().to_vec();
    let data = match value {
        Value::FloatTensor(t) => t.into_data(),
        Value::Int32Tensor(t) => t.into_data().into_iter().map(|v| v as f32).collect(),
        _ => return Err("an output that holds no numbers".to_owned()),
    };
    Ok(Tensor {
        name: String::new(),
        shape,
        data,
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::scores;
    use super::*;

    #[test]
    fn panicked_session_returns_errors() {
        let mut session = RtenSession::load(scores(), "image", 1).unwrap();
        let planes = vec![0.5; 27];
        assert_eq!(session.run(&planes, 3, 3).unwrap().len(), 2);
        let number = 7;
        let panic = session.attempt::<()>(|_| panic!("index {number}\nout of bounds"));
        let expected = "a panic: index 7 out of bounds".to_owned();
        assert_eq!(panic, Err(expected.clone()));
        assert_eq!(session.run(&planes, 3, 3), Err(expected));
        assert_eq!(guarded(|| 1), Ok(1));
        let inside = guarded(|| {
            (
                is_expected("/registry/rten/a.rs"),
                is_expected("crates/slam/a.rs"),
            )
        });
        assert_eq!(inside, Ok((true, false)));
        let other = guarded(|| std::panic::panic_any(1));
        assert_eq!(other, Err::<(), _>("a panic: without a message".to_owned()));
    }
}
