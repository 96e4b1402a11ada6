"""How a joined system is computed: poles and loops, or matrices, with and without laws at ports."""
