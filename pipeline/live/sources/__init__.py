"""Where live samples come from: Lab Streaming Layer, Qualisys; one module each."""
