//! The binary `palpate`.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    palpate_cli::run(std::env::args_os())
}
