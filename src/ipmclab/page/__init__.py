"""The page: the laboratory in a browser. Nothing here imports the compiler; fits run in processes of their own."""
