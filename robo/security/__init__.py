"""Who may do what on a network: a policy in words of robots and topics, keys and certificates, and Zenoh's rules."""
