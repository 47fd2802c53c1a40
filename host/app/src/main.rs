//! The binary `palpate`.

fn main() -> std::process::ExitCode {
    palpate_cli::run(std::env::args_os())
}
