// The view of simulate.js as an element of NiceGUI.
export default {
  template: "<div></div>",
  props: { options: Object },
  mounted() {
    this.view = new window.LabSimulate.View(this.$el, this.options, (state) => this.$emit("asked", state));
  },
  methods: {
    told() {
      return this.view.told();
    },
    complain(error) {
      this.view.complain(error);
    },
    set_runs(runs) {
      this.view.setRuns(runs);
    },
  },
  unmounted() {
    this.view.destroy();
  },
};
