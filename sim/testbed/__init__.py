"""What demo, end-to-end tests and benches share: processes, ports, domains, servers, mail."""
